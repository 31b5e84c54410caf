#!/usr/bin/env bash
# python.sh FOLDER ARGUMENTS…: the Windows Python that setup.sh has made. Drive Z: is the root of this system's files.
folder=$(cd "$1" && pwd)
shift
export WINEPREFIX=$folder/wine WINEDEBUG=${WINEDEBUG:--all}
# Wine's own OpenMP leaves out parts of LibRaw's loops; packages bring Microsoft's.
export WINEDLLOVERRIDES="ucrtbase=n;vcomp140=n,b"
export KMP_AFFINITY=disabled # Wine lacks what OpenMP asks of processors
unset PIP_FIND_LINKS NUMBA_CACHE_DIR
# Wine's services hold the output of who starts them, and Python's streams want a pipe.
wine cmd /c exit </dev/null >/dev/null 2>&1
set -o pipefail
wine "$folder/python/python.exe" "$@" </dev/null 2>&1 | cat
