"""The audit of releases that are not installed: each in an environment of its own."""
