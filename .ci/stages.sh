# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# Stages with a time and a result each, for .ci/run and .ci/full. Sourced, never run.

rows=()
failures=0

# stage NAME COMMAND...: run the command, time it, remember how it ended; go on in any case.
stage() {
    local name=$1 began=$SECONDS code=0
    shift
    printf '\n=== %s\n' "$name"
    "$@" || code=$?
    ended "$name" "$began" "$code"
}

# optional NAME COMMAND...: a stage that may say with exit code 77, and in its last line why, that
# it cannot be had here; needs $work.
optional() {
    local name=$1 began=$SECONDS code=0
    shift
    printf '\n=== %s\n' "$name"
    "$@" 2>&1 | tee "${work:?}/optional.txt"
    code=${PIPESTATUS[0]}
    if [ "$code" -eq 77 ]; then
        rows+=("$name|$((SECONDS - began))|skipped: $(tail -n 1 "$work/optional.txt" | tr '|' '/')")
        printf -- '--- %s: skipped\n' "$name"
        return 0
    fi
    ended "$name" "$began" "$code"
}

# ended NAME BEGAN CODE: remember how a stage ended.
ended() {
    local result=passed
    if [ "$3" -ne 0 ]; then
        result="FAILED ($3)"
        failures=$((failures + 1))
    fi
    rows+=("$1|$((SECONDS - $2))|$result")
    printf -- '--- %s: %s\n' "$1" "$result"
}

# skipped NAME WHY: a stage that cannot be had here, said aloud and kept in the table.
skipped() {
    printf '\n=== %s\n--- skipped: %s\n' "$1" "$2"
    rows+=("$1|0|skipped: $2")
}

# table: what ran, as Markdown.
table() {
    local row name seconds result
    printf '| stage | s | result |\n|---|---:|---|\n'
    for row in "${rows[@]}"; do
        IFS='|' read -r name seconds result <<<"$row"
        printf '| %s | %s | %s |\n' "$name" "$seconds" "$result"
    done
}

# other_python VERSION: print the path of a Python of that version, such as 3.13; fail if none.
other_python() {
    local candidate
    for candidate in "python$1" "${HOME:-}"/.pyenv/versions/"$1"*/bin/"python$1"; do
        if "$candidate" -c "import ensurepip, sys, venv; sys.exit('%d.%d' % sys.version_info[:2] != '$1')" >/dev/null 2>&1; then
            "$candidate" -c 'import sys; print(sys.executable)'
            return
        fi
    done
    return 1
}

# in_empty_folder COMMAND...: run it where nothing of the project lies; needs $work.
in_empty_folder() {
    local folder
    folder=$(mktemp -d "${work:?}/empty.XXXXXX") || return 2
    (cd "$folder" && "$@")
}
