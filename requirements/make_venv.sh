#!/bin/sh
# Make .venv in the current folder with the first Python that will do. PYTHON, when set, is the only one tried.
set -u

minimum='3.11'
old=''
bare=''

if [ -n "${PYTHON:-}" ]; then
    set -- "$PYTHON"
else
    set -- python3 python3.13 python3.12 python3.11 python3.14
fi

for python in "$@"; do
    found=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null) || continue
    if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
        old="$old $python is $found;"
    elif ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        bare="$found"
    else
        echo "making .venv with Python $found"
        "$python" -m venv --clear .venv && exit 0
        echo "error: '$python -m venv .venv' failed, see above." >&2
        exit 1
    fi
done

if [ -n "$bare" ]; then
    echo "error: Python $bare lacks its venv or ensurepip module. On Debian and Ubuntu:" >&2
    echo "    sudo apt-get install python3-venv        (or python$bare-venv)" >&2
elif [ -n "$old" ]; then
    echo "error: lacet needs Python $minimum or newer; found:$old" >&2
    echo "Install a newer one beside it and say: make demo PYTHON=/path/to/python3" >&2
else
    echo "error: no Python found${PYTHON:+ at '$PYTHON'}; lacet needs Python $minimum or newer." >&2
    echo "    sudo apt-get install python3 python3-venv" >&2
fi
exit 1
