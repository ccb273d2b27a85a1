"""The synthetic line and ellipse experiments: both rules on the same streams of samples."""
