#!/bin/sh
# Create or update .venv: tools/setup.sh all (to run), tools/setup.sh dev (to run and to test).
# Does nothing if it is up to date: same directory, same Python, same pyproject.toml, same extension in C.
set -eu
cd "$(dirname "$0")/.."

extra=${1:-dev}

say() { # English, Japanese
    case ${ORINKIT_LANG:-${LC_ALL:-${LC_MESSAGES:-${LANG:-en}}}} in
        ja*) printf '%s\n' "$2" >&2 ;;
        *) printf '%s\n' "$1" >&2 ;;
    esac
}

usable() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; }

wanted="$(pwd) $(cat pyproject.toml hatch_build.py csrc/* | cksum)"
for stamp in ".venv/.$extra" .venv/.dev; do # dev includes all
    if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && usable .venv/bin/python; then
        exit 0
    fi
done

python=
for name in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11 python}; do
    if usable "$name"; then
        python=$name
        break
    fi
done
if [ -z "$python" ]; then
    say "orinkit requires Python 3.11 or newer, which was not found. Install it (Debian, Ubuntu: apt-get install python3 python3-venv), or specify its path: make PYTHON=/path/to/python3.11 ..." \
        "Python 3.11 以降が見つかりません。インストールするか (Debian, Ubuntu: apt-get install python3 python3-venv)、make PYTHON=/path/to/python3.11 ... のように指定してください。"
    exit 1
fi

make_venv() { "$python" -m venv --clear .venv; }

install_package() { # install the first of the given Debian packages that is available
    [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1 || return 1
    say "Installing $1 ..." "$1 をインストールします ..."
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq >&2 || true
    for package in "$@"; do
        apt-get install -y -qq "$package" >&2 && return 0
    done
    return 1
}

install_venv() { # Debian has venv in a separate package
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    install_package "python$version-venv" python3-venv
}

if ! .venv/bin/python -c 'import pip' >/dev/null 2>&1 || ! usable .venv/bin/python; then
    say "Creating .venv with $("$python" --version) ..." "$("$python" --version) で .venv を作成します ..."
    if ! "$python" -c 'import ensurepip, venv' >/dev/null 2>&1; then
        install_venv || true
    fi
    if ! make_venv; then
        rm -rf .venv
        say "Cannot create a virtual environment with $python. Debian, Ubuntu: apt-get install python3-venv, then retry." \
            "$python で仮想環境を作成できません。Debian, Ubuntu では apt-get install python3-venv の後、もう一度実行してください。"
        exit 1
    fi
fi

rm -f .venv/.all .venv/.dev
unset ORINKIT_PURE # .venv always contains the extension in C; this variable disables it at run time
say "Installing orinkit[$extra] into .venv ..." "orinkit[$extra] を .venv にインストールします ..."
if ! .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-input --root-user-action ignore -e ".[$extra]"; then
    say "Cannot install the packages (see above). Check the network, and that pip can reach its package index." \
        "パッケージをインストールできません (上記を参照)。ネットワークと pip のパッケージインデックスを確認してください。"
    exit 1
fi
if [ "$extra" = dev ] && ! command -v tshark >/dev/null 2>&1; then
    install_package tshark || # the tests that need it are skipped, with this reason
        say "tshark is missing: the tests of the Wireshark dissector will be skipped. Debian, Ubuntu: apt-get install tshark" \
            "tshark がないため、Wireshark のディセクタのテストは省略されます。Debian, Ubuntu: apt-get install tshark"
fi
if [ "$extra" = dev ] && ! command -v chromium >/dev/null 2>&1; then
    { install_package chromium && install_package fonts-noto-cjk; } || # the tests that need it are skipped, with this reason
        say "Chromium is missing: the browser tests of the Tester will be skipped. Debian, Ubuntu: apt-get install chromium fonts-noto-cjk" \
            "Chromium がないため、Tester のブラウザテストは省略されます。Debian, Ubuntu: apt-get install chromium fonts-noto-cjk"
fi
.venv/bin/python -m compileall -q src || true # makes the first start as fast as later ones
printf '%s\n' "$wanted" >".venv/.$extra"
