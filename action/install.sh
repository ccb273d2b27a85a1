#!/usr/bin/env bash
# Installs this checkout into an environment of its own and puts its commands on the path.
set -euo pipefail
python=$(command -v python3 || command -v python)
"$python" -m venv "$RUNNER_TEMP/ransac-fix"
commands=$RUNNER_TEMP/ransac-fix/bin
[ -d "$commands" ] || commands=$RUNNER_TEMP/ransac-fix/Scripts # Windows
"$commands/python" -m pip install --quiet "$ACTION_PATH"
echo "$commands" >>"$GITHUB_PATH"
