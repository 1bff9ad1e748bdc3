# Sourced by tools/demo and tools/test: installs what a bare Debian or Ubuntu with Python and git lacks.
#
# Leaves $root (the checkout) and $py (the environment's Python); $meanwhile names what else to install, a function of
# this file.  Installs system packages only as root or with password-free sudo; otherwise prints the exact command and
# exits 2.  A stamp makes the second run skip pip altogether.
# shellcheck shell=bash

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$root/.venv
py=$venv/bin/python

gl_packages=(libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri)

say() { printf '%s\n' "$*" >&2; }
stop() {
  say "$(basename "$0"): $*"
  exit 2
}

# apt_prefix: how apt-get may be run here (nothing, "sudo -n"), or status 1 if it may not.
apt_prefix() {
  command -v apt-get >/dev/null || return 1
  if [ "$(id -u)" = 0 ]; then return 0; fi
  if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    echo "sudo -n"
    return 0
  fi
  return 1
}

# apt_install PACKAGE...: quiet and unattended; a bare image has no package lists, so those are fetched when needed.
apt_install() {
  local prefix
  prefix=$(apt_prefix) || return 1
  local get="$prefix env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Dpkg::Use-Pty=0"
  $get install -y --no-install-recommends "$@" >/dev/null 2>&1 </dev/null && return 0
  $get update >/dev/null 2>&1 </dev/null
  # The output of apt-get matters only if it fails.
  local output
  output=$($get install -y --no-install-recommends "$@" 2>&1 </dev/null) || {
    say "$output"
    return 1
  }
}

# need_apt WHAT PACKAGE...: install, or stop with the command that would.
need_apt() {
  local what=$1
  shift
  say "$what; installing: $*"
  apt_install "$@" || stop "$what. Install it and run this again:
  sudo apt-get update && sudo apt-get install -y --no-install-recommends $*"
}

find_python() {
  local candidate
  for candidate in "${PYTHON:-}" python3 python3.13 python3.12 python3.11; do
    if [ -n "$candidate" ] && "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$candidate"
      return 0
    fi
  done
  stop "Python 3.11 or newer is needed (set PYTHON to one, or: sudo apt-get install -y python3 python3-venv)"
}

ensure_venv() {
  # Existence is not enough: an interrupted run leaves a partial environment, a system upgrade a dangling one.
  if "$py" -c 'import pip' 2>/dev/null; then return 0; fi
  local base version
  base=$(find_python) || exit 2
  version=$("$base" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  if ! "$base" -c 'import ensurepip, venv' 2>/dev/null; then
    need_apt "Python's venv module is missing" "python$version-venv"
  fi
  say "creating the environment .venv (Python $version)"
  "$base" -m venv --clear "$venv" || stop "cannot create $venv"
}

ensure_packages() {
  local stamp=$venv/.taubench-setup key
  # The path is part of the key: an editable install and the scripts of an environment hold absolute paths.
  key=$({ cat "$root/pyproject.toml" "$root/setup.py" "$root/constraints.txt"; "$py" -VV; echo "$root"; } | sha256sum)
  if [ "$(cat "$stamp" 2>/dev/null)" = "$key" ]; then return 0; fi
  say "installing taubench-gl and its dependencies into .venv (a minute or two, once)"
  # Without --no-compile a third of the time would go to modules that nothing imports.
  local pip=("$py" -m pip --disable-pip-version-check install -qq --no-compile --constraint "$root/constraints.txt")
  "${pip[@]}" --editable "$root[test]" || stop "pip could not install the package (see above)"
  # meshoptimizer has no wheels for some Pythons and is optional: without it, meshopt-compressed files cannot be read.
  "${pip[@]}" "meshoptimizer" >/dev/null 2>&1 \
    || say "note: meshoptimizer could not be installed (it needs a C++ compiler); scenes with EXT_meshopt_compression will not load"
  printf '%s\n' "$key" >"$stamp"
}

ensure_gl() {
  if "$py" "$root/tools/gl_probe.py" >/dev/null; then return 0; fi
  need_apt "no OpenGL driver was found" "${gl_packages[@]}"
  # An alternative to EGL, if the distribution has it; Mesa 25.1 dropped it.
  apt_install libosmesa6 2>/dev/null || say "note: this distribution has no libosmesa6; continuing with EGL only"
  "$py" "$root/tools/gl_probe.py" >&2 || stop "OpenGL still cannot be opened (see above)"
}

# ensure_test_programs: a display for the viewer, browsers for the reports, OSMesa.  Tests that lack one are skipped.
ensure_test_programs() {
  local missing=()
  command -v Xvfb >/dev/null || missing+=(xvfb)
  command -v chromium >/dev/null || missing+=(chromium)
  if [ ${#missing[@]} -gt 0 ]; then
    say "installing for the tests: ${missing[*]}"
    apt_install "${missing[@]}" || say "note: could not install ${missing[*]}; the tests that need them will be skipped"
  fi
  # If the distribution has it: Ubuntu's Firefox is a snap.
  if ! command -v firefox-esr firefox >/dev/null && apt-cache show firefox-esr >/dev/null 2>&1; then
    say "installing for the tests: firefox-esr"
    apt_install firefox-esr || say "note: could not install firefox-esr; the tests that need it will be skipped"
  fi
  # If the distribution has it; Mesa 25.1 dropped it.
  if ! ldconfig -p | grep -q libOSMesa && apt-cache show libosmesa6 >/dev/null 2>&1; then
    say "installing for the tests: libosmesa6"
    apt_install libosmesa6 || say "note: could not install libosmesa6; the tests that need it will be skipped"
  fi
}

# ensure_driver NAME: install the OpenGL driver NAME (tools/drivers.py) if it is missing.  Where it cannot be had: exit 2,
# or one line and exit 0 if TAUBENCH_SKIP_MISSING_DRIVER is set.
ensure_driver() {
  local reason package
  if "$py" "$root/tools/drivers.py" "$1" >/dev/null 2>&1; then return 0; fi
  package=$("$py" -c "import sys; sys.path.insert(0, sys.argv[1]); import drivers; print(drivers.PACKAGES[sys.argv[2]])" \
    "$root/tools" "$1" 2>/dev/null) || stop "no driver is named $1"
  say "installing the driver $1: $package"
  apt_install "$package" 2>/dev/null
  reason=$("$py" "$root/tools/drivers.py" "$1" 2>&1 >/dev/null) && return 0
  if [ -n "${TAUBENCH_SKIP_MISSING_DRIVER:-}" ]; then
    say "note: the tests on the driver $1 are skipped: $reason (apt-get install $package)"
    exit 0
  fi
  stop "$reason. Install it and run this again: sudo apt-get install -y --no-install-recommends $package"
}

# ensure_validator: the Khronos glTF validator, if npm can install it.  Otherwise its tests are skipped.
ensure_validator() {
  local folder=${GLTF_VALIDATOR:-$venv/gltf-validator}
  if [ ! -d "$folder/node_modules/gltf-validator" ]; then
    command -v npm >/dev/null && npm install --silent --no-audit --no-fund --prefix "$folder" \
      gltf-validator@2.0.0-dev.3.10 >/dev/null 2>&1 </dev/null || return 0
  fi
  export GLTF_VALIDATOR=$folder
}

# one_at_a_time: waits for another setup of this checkout, because two pips in one environment break it.  The lock is on
# the checkout's folder, so it leaves no file; it ends with done_setting_up, or with this process.
one_at_a_time() {
  command -v flock >/dev/null || return 0 # continue: not every system has flock
  exec 9<"$root"
  flock -n 9 2>/dev/null && return 0
  say "waiting for another tools/demo or tools/test that is setting up .venv"
  flock 9 || say "note: this folder cannot be locked; continuing"
}

done_setting_up() { exec 9<&-; }

one_at_a_time
ensure_venv
# The system's packages come while Python's do.
if [ -n "${meanwhile:-}" ]; then "$meanwhile" & fi
ensure_packages
wait
ensure_gl
done_setting_up
