#!/bin/sh
# Takes the settings of enable.sh away; they end with the next start of the computer.
set -eu
[ "$(id -u)" = 0 ] || { echo "disable.sh: to be run as administrator: sudo $0" >&2; exit 2; }
rm -f /etc/udev/rules.d/60-spherecal-cameras.rules /etc/sysctl.d/90-spherecal-cameras.conf /etc/tmpfiles.d/spherecal-usb.conf
if command -v udevadm > /dev/null; then udevadm control --reload || true; fi
echo "Done."
