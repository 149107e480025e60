#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# First process of the guest: loads SocketCAN, runs one script of the host, switches off.
# The script's path stands on the kernel's command line as job=PATH.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs run /run
mount -t tmpfs shm /dev/shm 2>/dev/null || { mkdir -p /dev/shm && mount -t tmpfs shm /dev/shm; }
mkdir -p /dev/pts
mount -t devpts devpts /dev/pts
ip link set lo up

modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in drivers/net/can/dev/can-dev net/can/can net/can/can-raw net/can/can-bcm \
    drivers/net/can/vcan drivers/net/can/slcan/slcan; do
    busybox insmod "$modules/$module.ko" || echo "cannot load $module"
done

/bin/sh "$(sed 's/.*job=\([^ ]*\).*/\1/' /proc/cmdline)"
busybox poweroff -f
