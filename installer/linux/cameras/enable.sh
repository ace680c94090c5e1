#!/bin/sh
# Puts the settings for GigE and USB3 cameras into force, now and at every start. Undo: disable.sh
set -eu
[ "$(id -u)" = 0 ] || { echo "enable.sh: to be run as administrator: sudo $0" >&2; exit 2; }
here=$(dirname "$(readlink -f "$0")")
install -m 644 "$here/60-spherecal-cameras.rules" /etc/udev/rules.d/
install -m 644 "$here/90-spherecal-cameras.conf" /etc/sysctl.d/
install -D -m 644 "$here/spherecal-usb.conf" /etc/tmpfiles.d/spherecal-usb.conf
if command -v udevadm > /dev/null; then udevadm control --reload || true; udevadm trigger --subsystem-match=usb || true; fi
if command -v sysctl > /dev/null; then sysctl -q -p /etc/sysctl.d/90-spherecal-cameras.conf || true; fi
if command -v systemd-tmpfiles > /dev/null; then systemd-tmpfiles --create /etc/tmpfiles.d/spherecal-usb.conf || true; fi
echo "Done. Network cards of GigE cameras: switch on jumbo frames as well, for example: ip link set eth1 mtu 9000"
