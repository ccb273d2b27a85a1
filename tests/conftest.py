"""Settings of all tests."""

from hypothesis import settings

# An example that takes longer on a busy machine is not a fault.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
