# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# Stages with a time and a result each, for .ci/run and .ci/full. Sourced, never run.

rows=()
failures=0
declare -A lanes=()

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
    local name=$1 began=$SECONDS code=0 said=${work:?}/optional.$BASHPID.txt
    shift
    printf '\n=== %s\n' "$name"
    "$@" 2>&1 | tee "$said"
    code=${PIPESTATUS[0]}
    if [ "$code" -eq 77 ]; then
        rows+=("$name|$((SECONDS - began))|skipped: $(tail -n 1 "$said" | tr '|' '/')")
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

# beside NAME FUNCTION: run the stages of the function while others go on; what they print is kept
# until `joined NAME`. A group of processes of its own: it ends with the whole, see `leave_nothing`.
beside() {
    local kept=${work:?}/beside.$1 rows=() failures=0
    printf '\n=== %s: begins, goes on beside what follows, and is shown when it is over\n' "$1"
    set -m
    (
        "$2"
        printf '%s\n' "${rows[@]}" >"$kept.rows"
        exit "$failures"
    ) >"$kept.txt" 2>&1 </dev/null &
    set +m
    lanes[$1]=$!
}

# joined NAME: wait for these stages, print what they said, take over how they ended.
joined() {
    local kept=${work:?}/beside.$1 count=0 row
    wait "${lanes[$1]}" || count=$?
    unset "lanes[$1]"
    cat "$kept.txt"
    if [ ! -s "$kept.rows" ]; then
        printf -- '--- %s: FAILED, they ended before their time\n' "$1"
        rows+=("$1|0|FAILED ($count)")
        failures=$((failures + 1))
        return
    fi
    while IFS= read -r row; do rows+=("$row"); done <"$kept.rows"
    failures=$((failures + count))
}

# leave_nothing: end what still runs beside, and remove $work; for a trap.
leave_nothing() {
    local group
    for group in "${lanes[@]}"; do kill -- "-$group" 2>/dev/null; done
    rm -rf "${work:?}"
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
