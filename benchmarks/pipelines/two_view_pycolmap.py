"""pycolmap's two-view functions over image pairs.

    ransac-fix trace --verify benchmarks/pipelines/two_view_pycolmap.py DATA

DATA is a folder of NPZ files whose keys hold rows ``x1 y1 x2 y2 ratio ...``, one image pair each.
"""

import sys
from pathlib import Path

import numpy as np
import pycolmap


def main(folder: Path) -> None:
    """Estimate homographies, fundamental matrices and two-view geometry of up to 6 pairs a file."""
    options = pycolmap.RANSACOptions(max_error=3.0, max_num_trials=2000, min_num_trials=0)
    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=1000, height=800, params=[900, 500, 400])
    for path in sorted(folder.rglob("*.npz")):
        if path.name.startswith(("pnp_", "reg3d")):
            continue
        with np.load(path) as pairs:
            keys = sorted(key for key in pairs.files if not key.endswith("__gt"))
            for key in keys[:: max(1, len(keys) // 6)][:6]:
                rows = np.asarray(pairs[key], float)
                rows = rows[rows[:, 4] < 0.85]
                if len(rows) < 15:
                    continue
                x, y = (np.ascontiguousarray(rows[:, i : i + 2]) for i in (0, 2))
                matches = np.arange(len(rows), dtype=np.uint32).repeat(2).reshape(-1, 2)
                pycolmap.estimate_homography_matrix(x, y, options)
                pycolmap.estimate_fundamental_matrix(x, y, options)
                pycolmap.estimate_two_view_geometry(camera, x, camera, y, matches)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
