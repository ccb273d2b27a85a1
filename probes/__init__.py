"""Probes, one file a library, found through the ``ransac_fix.probes`` entry points."""
