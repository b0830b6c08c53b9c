#!/bin/sh
# Install what apt-packages.txt lists; done within milliseconds if it is all there. Called by `make setup`.
list=$(cat "$(dirname "$0")/../apt-packages.txt")
command -v dpkg-query >/dev/null || {
  echo "setup needs Debian 12 or a system with its packages; here install by other means:" $list >&2
  exit 2
}
installed=$(dpkg-query -W -f '${db:Status-Status} ${Package}\n' $list 2>/dev/null | sed -n 's/^installed //p')
missing=
for package in $list; do
  echo "$installed" | grep -qxF "$package" || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

if [ "$(id -u)" = 0 ]; then
  become=
elif sudo -n true 2>/dev/null; then
  become=sudo
else
  echo "missing packages:$missing; install them with: sudo apt-get install$missing" >&2
  exit 2
fi
apt() { $become env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=300 "$@" >/dev/null; }
echo "installing$missing (a minute or two)"
apt update && apt install -y --no-install-recommends $missing || {
  echo "installing failed; try: sudo apt-get update && sudo apt-get install$missing" >&2
  exit 2
}
