"""Both rules on real correspondences: homographies, essential and fundamental matrices, PnP."""
