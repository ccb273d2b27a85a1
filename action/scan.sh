#!/usr/bin/env bash
# The scan of the GitHub Action: annotations on standard output, a SARIF file, and a summary.
set -euo pipefail
arguments=()
[ -z "${INPUT_SELECT:-}" ] || arguments+=(--select "$INPUT_SELECT")
[ -z "${INPUT_IGNORE:-}" ] || arguments+=(--ignore "$INPUT_IGNORE")
[ -z "${INPUT_BASELINE:-}" ] || arguments+=(--baseline "$INPUT_BASELINE")
[ -z "${INPUT_PYTHON:-}" ] || arguments+=(--python "$INPUT_PYTHON")
paths=()
while IFS= read -r line; do
    [ -z "$line" ] || paths+=("$line")
done <<<"${INPUT_PATHS:-.}"
sarif=$RUNNER_TEMP/ransac-fix.sarif
summary=$RUNNER_TEMP/ransac-fix.md
rm -f "$sarif" "$summary"
status=0
ransac-fix scan ${arguments[@]+"${arguments[@]}"} --output-format github \
    --output "sarif:$sarif" --output "markdown:$summary" -- "${paths[@]}" || status=$?
[ ! -f "$summary" ] || cat "$summary" >>"$GITHUB_STEP_SUMMARY"
[ ! -f "$sarif" ] || echo "sarif=$sarif" >>"$GITHUB_OUTPUT"
if [ "$status" = 1 ] && [ "${INPUT_FAIL:-true}" != true ]; then
    status=0
fi
exit "$status"
