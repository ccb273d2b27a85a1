"""OpenCV: the classic estimators (``cv2.RANSAC``) and the USAC framework.

The classic estimators draw from a generator of fixed state, so only the order of the measurements
changes the stream. Neither reports its trials.
"""

from typing import Any

from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import Planted


def _outcome(mask: Any) -> Outcome:
    return Outcome(None if mask is None else mask.ravel().astype(bool))


def _entry_points(cv2: Any) -> list[EntryPoint | Unmeasured]:
    cv2.setNumThreads(1)

    def homography(method: int) -> Any:
        def run(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
            options = {} if settings is None else _options(settings)
            _, mask = cv2.findHomography(planted.x, planted.y, method, planted.threshold, **options)
            return _outcome(mask)

        return run

    def affine(method: int) -> Any:
        def run(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
            options = {} if settings is None else _options(settings)
            _, mask = cv2.estimateAffine2D(
                planted.x,
                planted.y,
                method=method,
                ransacReprojThreshold=planted.threshold,
                **options,
            )
            return _outcome(mask)

        return run

    def _options(settings: Settings) -> dict[str, Any]:
        return {"maxIters": settings.max_trials, "confidence": settings.confidence}

    entry_points: list[EntryPoint | Unmeasured] = []
    for name in ("RANSAC", "USAC_DEFAULT"):
        entry_points += [
            EntryPoint(
                f"findHomography({name})",
                "homography",
                4,
                homography(getattr(cv2, name)),
                Defaults(0.995, max_trials=2000, max_trials_name="maxIters"),
                seeded=False,
            ),
            EntryPoint(
                f"estimateAffine2D({name})",
                "affine",
                3,
                affine(getattr(cv2, name)),
                Defaults(0.99, max_trials=2000, max_trials_name="maxIters"),
                seeded=False,
            ),
        ]
    return entry_points


PROBE = Probe(
    "opencv",
    "cv2",
    (
        "opencv-python-headless",
        "opencv-python",
        "opencv-contrib-python-headless",
        "opencv-contrib-python",
    ),
    _entry_points,
)
