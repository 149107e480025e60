#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs tests on a real SocketCAN, on a host whose kernel has none: in a User-Mode-Linux guest that
# sees the host's files read-only, so with the same Python environment.
#   bash .ci/socketcan/guest.sh [MORE ARGUMENTS OF PYTEST]
# All of tests/drivers/guest is run; what is added there needs nothing else.
# Exit code: pytest's; 77 when there cannot be a guest here, with the reason on stderr; 124 when it
# took longer than COMCAL_GUEST_SECONDS (240).
set -u
here=$(CDPATH='' cd "$(dirname "${BASH_SOURCE[0]}")" && pwd -P)
root=$(CDPATH='' cd "$here/../.." && pwd -P)
venv=${COMCAL_VENV:-$root/.venv}
case $venv in /*) ;; *) venv=$PWD/$venv ;; esac
python=$venv/bin/python
seconds=${COMCAL_GUEST_SECONDS:-240}
packages="user-mode-linux can-utils busybox-static iproute2 gcc libc6-dev"

skip() {
    printf 'socketcan guest: SKIPPED, nothing was tested: %s\n' "$*" >&2
    exit 77
}

[ "$(uname -sm)" = "Linux x86_64" ] || skip "User-Mode-Linux is for Linux on x86_64, this is $(uname -sm)"
for program in linux.uml busybox ip slcand gcc; do
    command -v "$program" >/dev/null 2>&1 || skip "no $program here; apt-get install $packages"
done
[ -x "$python" ] || skip "no $python; ./run setup makes it"
work=$(mktemp -d) || exit 2
trap 'rm -rf "$work"' EXIT
case $here$work in *[[:space:]]*) skip "a path with a blank cannot be told to the guest: $here, $work" ;; esac

gcc -O2 -shared -fPIC -o "$work/xshim.so" "$here/xshim.c" || skip "xshim.c cannot be compiled"

{
    printf 'cd %q\n' "$root"
    # The host's folder for results is the only place where the guest writes.
    printf 'mkdir -p /run/tmp /run/out; mount -t hostfs none /run/out -o %q\n' "$work"
    printf 'ip link add dev vcan0 type vcan && ip link set vcan0 up\n'
    # What ./run test has compiled; the guest writes nothing here, so each program would do it anew.
    [ ! -d "$venv/pycache" ] || printf 'export PYTHONPYCACHEPREFIX=%q\n' "$venv/pycache"
    # COMCAL_GUEST: here the tests fail where elsewhere they skip.
    printf 'export HOME=/run/tmp TMPDIR=/run/tmp PYTHONDONTWRITEBYTECODE=1 OMP_NUM_THREADS=1\n'
    printf 'export COMCAL_GUEST=1 HYPOTHESIS_STORAGE_DIRECTORY=/run/tmp/hypothesis\n'
    printf '%q -m pytest -p no:cacheprovider --color=no tests/drivers/guest' "$python"
    [ "$#" -eq 0 ] || printf ' %q' "$@"
    printf ' >/run/out/pytest.txt 2>&1 </dev/null\necho $? >/run/out/code\n'
} >"$work/job.sh"
[ -x "$here/init.sh" ] || chmod +x "$here/init.sh"

# The guest's memory is a file: in /dev/shm, unless that is as small as containers have it.
free=$(df --output=avail -k /dev/shm 2>/dev/null | tail -n 1)
[ "${free:-0}" -gt 700000 ] || export TMPDIR=$work

code=0
LD_PRELOAD=$work/xshim.so timeout --kill-after=5 "$seconds" linux.uml \
    root=/dev/root rootfstype=hostfs rootflags=/ ro mem=640M uml_dir="$work" \
    init="$here/init.sh" job="$work/job.sh" con=null con0=null,fd:1 ssl=null quiet \
    </dev/null >"$work/console.txt" 2>&1 || code=$?

[ ! -s "$work/pytest.txt" ] || cat "$work/pytest.txt"
if [ "$code" -eq 124 ] || [ "$code" -eq 137 ]; then
    printf 'socketcan guest: stopped after %s s; COMCAL_GUEST_SECONDS allows more\n' "$seconds" >&2
    exit 124
fi
if [ ! -s "$work/code" ]; then
    tail -n 15 "$work/console.txt" >&2
    [ ! -e "$work/pytest.txt" ] || exit 1
    skip "the guest did not start (its last words are above)"
fi
exit "$(cat "$work/code")"
