#!/usr/bin/env bash
# A Windows Python with all packages, Blender's too, under Wine: what fails for people with Windows is seen
# without one.
#
#     tests/wine/setup.sh FOLDER                     three minutes, 4 GB
#     tests/wine/python.sh FOLDER -m pytest -q tests/job
#
# Needs, as Debian and Ubuntu name them: wine64 (or wine), gcc-mingw-w64-x86-64; and python3.11 with pip.
# Python's library for Windows is Panda3D's, which brings it for programs that are to run there; what is
# written in Python is as on any system. What Wine 8 lacks is in the .c files and in sitecustomize.py.
# It is not Windows: paths have no longest length there, links do nothing, `taskkill` knows no /T.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
python=${PYTHON:-python3.11}
folder=$(mkdir -p "$1" && cd "$1" && pwd)
home=$folder/python
system=$folder/wine/drive_c/windows/system32
compile() { x86_64-w64-mingw32-gcc -O1 "$@"; }
mkdir -p "$home/DLLs"

"$python" -m pip download --quiet --no-deps --only-binary :all: --platform win_amd64 --python-version 3.11 \
    --dest "$folder/wheels" panda3d==1.10.16
"$python" "$here/libraries.py" "$folder"/wheels/panda3d-*.whl "$home"
cp -r "$("$python" -c 'import sysconfig; print(sysconfig.get_path("stdlib"))')" "$home/Lib"
rm -rf "$home"/Lib/{site-packages,lib-dynload,test} "$home"/Lib/config-*
mkdir -p "$home/Lib/site-packages" "$home/Lib/venv/scripts/nt"
cp "$here/sitecustomize.py" "$home/Lib/site-packages/"

compile -municode "$here/python.c" -o "$home/python.exe"
compile -municode "$here/launcher.c" -o "$home/Lib/venv/scripts/nt/python.exe"
"$python" "$here/forwarders.py" "$home/python311.dll" python311 >"$folder/python3.def"
compile -shared "$here/nothing.c" "$folder/python3.def" -o "$home/python3.dll"

WINEPREFIX=$folder/wine WINEDEBUG=-all wineboot --init >"$folder/wine.log" 2>&1
compile -shared "$here/random.c" -o "$system/bcryptprimitives.dll" -ladvapi32
# Wine's own goes by another name, and ours, in front of it, has the complex functions.
"$python" "$here/forwarders.py" --move "$system/ucrtbase.dll" ucrtwine cexp clog cpow csqrt csin ccos csinh \
    ccosh ctan ctanh >"$folder/ucrtbase.def"
compile -shared "$here/complex.c" "$folder/ucrtbase.def" -o "$folder/ucrtbase.dll"
mv "$folder/ucrtbase.dll" "$system/"

"$python" -m pip install --quiet --target "$home/Lib/site-packages" pip
# bpy and what tests need, without what is for drawing windows on Linux.
"$here/python.sh" "$folder" -m pip install --quiet --no-warn-script-location \
    -r "$root/requirements/development.txt" -c "$root/requirements/constraints.txt"
"$here/python.sh" "$folder" -c "import bpy, torch; print('Windows has torch', torch.__version__)"
