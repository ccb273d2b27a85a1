"""Run-time patches, one file a library, found through the ``ransac_fix.patches`` entry points."""
