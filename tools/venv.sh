# Makes .venv, and makes it again if requirements change or packages are missing. Sourced by tools/start, tools/test, tools/wheel.
# Sets: root, python. Arguments of trocar_venv: the extras to install, e.g. demo dev; TROCAR_EXTRAS adds more.

root=$(cd "$(dirname "$0")/.." && pwd)
python="$root/.venv/bin/python"
stamp="$root/.venv/.trocar" # lines: requirements and folder, extras, TROCAR_PYTHON, then a package each
new="$root/.venv-new"       # becomes .venv once it is complete
log="$root/.venv.log"

# The extra `ros` needs cyclonedds, the one package that has no wheel for some Pythons (pyproject.toml, docs/platforms.md).
trocar_has_ros() {
    case $1-$(uname -m) in 3.1[123]-x86_64) ;; *) false ;; esac
}

trocar_fails() {
    echo "trocar: $1" >&2
    return 1
}

# The Pythons among the arguments, newest first, a line each: 3.13 venv /usr/bin/python3.13
trocar_pythons() {
    for candidate; do
        "$candidate" -c 'import os, sys
from importlib.util import find_spec
print("%d.%d" % sys.version_info[:2], "venv" if find_spec("ensurepip") else "bare", os.path.realpath(sys.executable))' 2>/dev/null || :
    done | sort -t . -k 2,2nr
}

# Sets base and version: the newest Python that has all packages, else the newest; reason: its choice, in words.
trocar_choose() {
    base="" newest="" bare=""
    if [ -n "${TROCAR_PYTHON:-}" ]; then set -- "$TROCAR_PYTHON"; else set -- python3 python3.14 python3.13 python3.12 python3.11; fi
    while read -r found able path; do
        case $found-$able in
            3.1[1-4]-venv) newest=${newest:-$found} ;;
            3.1[1-4]-bare) bare=$found; continue ;;
            *) continue ;;
        esac
        if [ -z "$base" ] || trocar_has_ros "$found"; then version=$found base=$path; fi
        if trocar_has_ros "$version"; then break; fi
    done <<PYTHONS
$(trocar_pythons "$@")
PYTHONS
    if [ -n "$base" ]; then
        if ! trocar_has_ros "$version"; then
            reason="without the ROS bridge: cyclonedds has no package for $version on $(uname -m)"
        elif [ "$version" != "$newest" ]; then
            reason="as the ROS bridge needs cyclonedds, which has no package for $newest"
        else
            reason=${TROCAR_PYTHON:-the newest here}
        fi
    elif [ -n "$bare" ]; then
        trocar_fails "Python $bare has no venv module; do: sudo apt-get install python$bare-venv"
    elif [ -n "${TROCAR_PYTHON:-}" ]; then
        trocar_fails "TROCAR_PYTHON=$TROCAR_PYTHON is not Python 3.11 to 3.14; unset it, or set it to one"
    else
        trocar_fails "found no Python 3.11 to 3.14 (python3 is: $(python3 --version 2>/dev/null || echo missing)); do: sudo apt-get install python3-venv, or set TROCAR_PYTHON"
    fi
}

# Whether .venv has the extras given and all that its stamp lists. Sets has: its extras; why: the reason if it is not ready.
trocar_is_ready() {
    has="" chosen="" why="first use"
    [ -f "$stamp" ] || return 1
    {
        why="the requirements changed, or the folder has moved"
        read -r made; read -r has; read -r chosen
        [ "$made" = "$wanted" ] || return 1
        why="another Python was chosen"
        [ "${TROCAR_PYTHON:-$chosen}" = "$chosen" ] || return 1
        for extra; do
            why="the extra $extra is missing"
            case " $has " in *" $extra "*) ;; *) return 1 ;; esac
        done
        while read -r part; do
            why="$part is missing"
            [ -e "$root/.venv/$part" ] || return 1
        done
    } < "$stamp"
}

# pip's output as one line that changes; it is for terminals only.
trocar_progress() {
    if [ ! -t 2 ] || [ "${TERM:-dumb}" = dumb ]; then
        exec cat >/dev/null
    fi
    while read -r first rest; do
        case $first in Collecting | Downloading | Installing | Building) printf '\r\033[K%.58s' "$first $rest" >&2 ;; esac
    done
    printf '\r\033[K' >&2
}

# Makes .venv beside the old one, then swaps them: no package stays that is no longer required.
trocar_make() {
    ! command -v "$chosen" >/dev/null || TROCAR_PYTHON=${TROCAR_PYTHON:-$chosen}
    trocar_choose || return
    # shellcheck disable=SC2086  # words, each an extra
    extras=$(printf '%s\n' "$@" $has | sort -u | tr '\n' ,)
    echo "trocar: preparing .venv ($why) with Python $version, $reason; about a minute" >&2
    rm -rf "$new" "$root/.venv-old"
    {
        "$base" -m venv "$new" && "$new/bin/python" -m pip install --disable-pip-version-check --no-input --no-compile \
            -c "$root/constraints.txt" -e "${root}[${extras%,}]"
        echo "ended $?"
    } 2>&1 | tee "$log" | trocar_progress
    if [ "$(tail -n 1 "$log")" != "ended 0" ]; then
        rm -rf "$new"
        if grep -q 'after connection broken' "$log" && grep -q 'ERROR: No matching distribution' "$log"; then
            cause="no connection to the package index"
        else
            cause=$({ tail -n 2 "$log" | head -n 1; grep '^ *ERROR' "$log"; } | tail -n 1 | sed 's/^ *//')
        fi
        trocar_fails "cannot make .venv: $cause; all output is in $log; run again to retry"
        return
    fi
    (
        cd "$new" || exit
        grep -lI '\.venv-new' bin/* pyvenv.cfg | xargs sed -i 's/\.venv-new/.venv/g'
        # Bytecode of the modules used; pip would compile three times as much. Python compiles the others when it loads them.
        bin/python -m compileall -q -x '/(OpenGL|tests|lexers|f2py|distutils)/' lib/python*/site-packages \
            "$root/procs" "$root/shm" "$root/tools" >/dev/null 2>&1
        {
            printf '%s\n' "$wanted" "$(echo "$extras" | tr , ' ')" "${TROCAR_PYTHON:-}" bin/python
            find lib -name '*.dist-info' ! -name 'pip-*'
        } > .trocar
    ) || return
    [ ! -e "$root/.venv" ] || mv "$root/.venv" "$root/.venv-old"
    mv "$new" "$root/.venv" && rm -rf "$root/.venv-old"
}

trocar_environment() {
    # the part of pyproject.toml before the settings of tools, and all constraints
    wanted="$(sed '/^\[tool\./,$d' "$root/pyproject.toml" | cat - "$root/constraints.txt" | cksum) $root"
    trocar_is_ready "$@" && return
    for place in "$root" "$root/.venv" "$root/.venv.lock" "$log"; do
        if [ -e "$place" ] && [ ! -w "$place" ]; then
            trocar_fails "cannot make .venv: no permission to write $place; remove it, or clone the project into a folder of your own"
            return
        fi
    done
    (
        if command -v flock >/dev/null && ! flock -n 9; then
            echo "trocar: .venv is being made by another program; waiting" >&2
            flock 9
        fi
        trocar_is_ready "$@" || trocar_make "$@"
    ) 9> "$root/.venv.lock"
}

# Compiles the part in C, once for each version of source and compiler. Without it everything works, but more slowly.
trocar_native() {
    [ -w "$root/.venv" ] || return 0
    native_stamp="$root/.venv/.trocar-native"
    made_of=$(cat "$root"/procs/native/* "$root"/procs/fpga/*.py 2>/dev/null | cksum; "${CC:-cc}" --version 2>/dev/null)
    if [ ! -f "$native_stamp" ] || [ "$(cat "$native_stamp")" != "$made_of" ]; then
        (cd "$root" && "$python" -m trocar.procs.native.build >&2) || :
        echo "$made_of" > "$native_stamp"
    fi
}

trocar_venv() {
    # shellcheck disable=SC2086  # words, each an extra
    trocar_environment "$@" ${TROCAR_EXTRAS:-} && trocar_native
}
