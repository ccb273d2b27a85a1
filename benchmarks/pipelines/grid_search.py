"""A grid search over RANSACRegressor in several processes, on the diabetes data of scikit-learn.

ransac-fix trace --verify benchmarks/pipelines/grid_search.py
"""

from sklearn.datasets import load_diabetes
from sklearn.linear_model import RANSACRegressor
from sklearn.model_selection import GridSearchCV


def main() -> None:
    """Search, and print the best setting."""
    x, y = load_diabetes(return_X_y=True)
    grid = {
        "residual_threshold": [20.0, 30.0, 40.0],
        "min_samples": [5, 11],
        "stop_probability": [0.9, 0.99],
    }
    search = GridSearchCV(RANSACRegressor(max_trials=2000, random_state=0), grid, cv=3, n_jobs=2)
    search.fit(x, y)
    print(search.best_params_)


if __name__ == "__main__":
    main()
