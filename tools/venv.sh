# Makes the project's own .venv on first use and again when its requirements change. Sourced by tools/start and tools/test.
# Sets: root, python. Argument: the extras to install, e.g. "" or "[dev,bench]".

root=$(cd "$(dirname "$0")/.." && pwd)
python="$root/.venv/bin/python"

trocar_is_new_enough() {
    "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

trocar_find_python() {
    for candidate in ${TROCAR_PYTHON:+"$TROCAR_PYTHON"} python3 python3.13 python3.12 python3.11; do
        if trocar_is_new_enough "$candidate"; then
            echo "$candidate"
            return 0
        fi
    done
    return 1
}

# What pip does, as one line that changes on a terminal, else a line for each package; errors go through as they are.
trocar_install() {
    {
        "$python" -m pip install --disable-pip-version-check --no-compile -c "$root/constraints.txt" -e "$root$1"
        echo "trocar-pip-ended $?"
    } | {
        ended=1
        while read -r first rest; do
            case $first in
                trocar-pip-ended) ended=$rest ;;
                Collecting | Downloading | Installing | Building)
                    if [ -t 2 ]; then
                        printf '\r\033[K%.100s' "$first $rest" >&2
                    elif [ "$first" != Downloading ]; then
                        echo "$first $rest" >&2
                    fi ;;
            esac
        done
        [ -t 2 ] && printf '\r\033[K' >&2
        return "$ended"
    }
}

# Bytecode of what is loaded at all; pip would compile three times as much. What is left out is compiled when it is used.
trocar_compile() {
    "$python" -m compileall -q -x '/(OpenGL|tests|lexers|f2py|distutils)/' "$root"/.venv/lib/python*/site-packages \
        "$root/procs" "$root/shm" "$root/tools" >/dev/null 2>&1 || :
}

# The part of the program that is written in C, once for each source and compiler; without it all runs, slower.
trocar_native() {
    native_stamp="$root/.venv/.trocar-native"
    made_of=$(cat "$root"/procs/native/* "$root"/procs/fpga/*.py 2>/dev/null | cksum; "${CC:-cc}" --version 2>/dev/null)
    if [ ! -f "$native_stamp" ] || [ "$(cat "$native_stamp")" != "$made_of" ]; then
        (cd "$root" && "$python" -m trocar.procs.native.build >&2) || :
        echo "$made_of" > "$native_stamp"
    fi
}

trocar_venv() {
    trocar_environment "$1" && trocar_native
}

trocar_environment() {
    extras=$1
    if [ -n "${TROCAR_PYTHON:-}" ] && ! trocar_is_new_enough "$TROCAR_PYTHON"; then
        echo "trocar: TROCAR_PYTHON=$TROCAR_PYTHON is no Python 3.11 or newer; unset it, or give it one" >&2
        return 1
    fi
    stamp="$root/.venv/.trocar$extras"
    wanted=$(cat "$root/pyproject.toml" "$root/constraints.txt" | cksum)
    set -- "$stamp"
    [ -n "$extras" ] || set -- "$stamp" "$root"/.venv/.trocar\[* # one that has more than the program needs will do
    for made; do
        [ -x "$python" ] && [ -f "$made" ] && [ "$(cat "$made")" = "$wanted" ] && return 0
    done
    if [ ! -w "$root" ]; then
        echo "trocar: you may not write in $root, where .venv is made; clone it into a folder of your own" >&2
        return 1
    fi
    if ! base=$(trocar_find_python); then
        echo "trocar: needs Python 3.11 or newer, found $(python3 --version 2>&1 || echo none); try: sudo apt-get install python3.11 python3.11-venv" >&2
        return 1
    fi
    if ! "$base" -c 'import venv, ensurepip' 2>/dev/null; then
        echo "trocar: this Python cannot make virtual environments; try: sudo apt-get install python3-venv" >&2
        return 1
    fi
    echo "trocar: preparing .venv (first use, or the requirements changed); half a minute" >&2
    if [ ! -x "$python" ] && ! "$base" -m venv "$root/.venv" >&2; then
        echo "trocar: no virtual environment could be made in $root/.venv" >&2
        return 1
    fi
    if ! trocar_install "$extras"; then
        echo "trocar: the installation failed; is the network there? Run again to retry" >&2
        return 1
    fi
    trocar_compile
    echo "$wanted" > "$stamp"
}
