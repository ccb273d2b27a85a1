"""The audit: planted problem, flip points, laws, verdict."""
