"""SIFT and ORB matches of scikit-image's stereo pair, through OpenCV's RANSAC functions.

ransac-fix trace --verify benchmarks/pipelines/stereo_opencv.py
"""

import cv2
import numpy as np
import skimage.data


def matches(detector: cv2.Feature2D, norm: int, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Return matching points of the two pictures that pass the ratio test."""
    left, right, _ = skimage.data.stereo_motorcycle()
    found = [
        detector.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None)
        for image in (left, right)
    ]
    (points, descriptors), (others, other_descriptors) = found
    pairs = cv2.BFMatcher(norm).knnMatch(descriptors, other_descriptors, k=2)
    good = [a for a, b in pairs if a.distance < ratio * b.distance]
    x = np.array([points[match.queryIdx].pt for match in good])
    y = np.array([others[match.trainIdx].pt for match in good])
    return x, y


def main() -> None:
    """Estimate everything from every set of matches."""
    camera = np.array([[994.978, 0, 311.193], [0, 994.978, 254.877], [0, 0, 1]])
    detectors = ((cv2.SIFT_create(4000), cv2.NORM_L2), (cv2.ORB_create(4000), cv2.NORM_HAMMING))
    for detector, norm in detectors:
        for ratio in (0.7, 0.85, 1.0):
            x, y = matches(detector, norm, ratio)
            cv2.findHomography(x, y, cv2.RANSAC, 3.0)
            cv2.findFundamentalMat(x, y, cv2.FM_RANSAC, 1.0)
            cv2.findEssentialMat(x, y, camera, cv2.RANSAC, 0.999, 1.0)
            cv2.estimateAffine2D(x, y)


if __name__ == "__main__":
    main()
