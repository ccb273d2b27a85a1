"""``python -m ransac_fix``."""

from ransac_fix.cli import main

main()
