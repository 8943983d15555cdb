#!/bin/sh
# Installs what is missing: tools/setup.sh [build|test].  Debian 12; as root, or with sudo.
set -eu

build="g++ cmake ninja-build pkg-config libopenimageio-dev libopenexr-dev libopencolorio-dev libcli11-dev libtbb-dev
       libhwy-dev nlohmann-json3-dev libzstd-dev libdeflate-dev zlib1g-dev libtiff-dev libjpeg-dev"
# Other people's readers and writers, a browser for reports, and the shells whose completions are tried out.
test="libgtest-dev openexr openimageio-tools ffmpeg libchealpix-dev chromium python3 man-db zsh fish locales python3-pil
      libegl-dev libgl-dev libgl1-mesa-dri libnvtt-bin zstd libepoxy-dev libegl1 libdevil-dev
      parallel slurm-wlm munge"

wanted=$build
if [ "${1:-build}" = test ]; then wanted="$build $test"; fi

missing=
for package in $wanted; do
  case $(dpkg-query -W -f '${Status}' "$package" 2>/dev/null || true) in
    "install ok installed") ;;
    *) missing="$missing $package" ;;
  esac
done
if [ -z "$missing" ]; then exit 0; fi

as_root=
if [ "$(id -u)" != 0 ]; then
  if ! command -v sudo >/dev/null; then
    echo "$0: these packages are missing, and there is neither root nor sudo to install them:$missing" >&2
    exit 1
  fi
  as_root="sudo"
fi
echo "$0: installing$missing" >&2
export DEBIAN_FRONTEND=noninteractive
{
  $as_root apt-get update -qq
  # shellcheck disable=SC2086
  $as_root apt-get install -y -qq --no-install-recommends $missing
} >&2
