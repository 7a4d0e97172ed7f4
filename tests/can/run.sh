#!/usr/bin/env bash
# Runs tests/can/checks.py on a kernel with real CAN interfaces, in a virtual machine that sees this machine's files.
#   tests/can/run.sh KERNEL BUSYBOX PROGRAM PYTHON
# KERNEL: a folder with an unpacked Debian kernel package; BUSYBOX: a static busybox. Needs qemu-system-x86_64.
set -euo pipefail
folder=$(cd "$(dirname "$0")/../.." && pwd)
kernel=$(realpath "$1") busybox=$(realpath "$2")
program=$(realpath "$3")
python=$(cd "$(dirname "$4")" && pwd)/$(basename "$4") # not its target: a virtual environment is where its link is
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
version=$(ls "$kernel/lib/modules")
modules=$kernel/lib/modules/$version
[ -f "$modules/modules.dep" ] || "$busybox" depmod -b "$kernel" "$version"

root=$work/root
mkdir -p "$root/bin" "$root/lib/modules/$version"
cp "$busybox" "$root/bin/busybox"
cp "$folder/tests/can/init" "$root/init"
chmod +x "$root/init"
cp "$modules"/modules.{order,builtin}* "$root/lib/modules/$version/" 2>/dev/null || true
for module in virtio virtio_ring virtio_pci 9pnet_virtio 9p overlay can can-raw can-bcm can-dev vcan slcan; do
    line=$(grep -E "/${module//[-_]/[-_]}\.ko(\.xz)?:" "$modules/modules.dep" | head -1) || continue # built in
    for file in ${line//:/}; do
        mkdir -p "$root/lib/modules/$version/$(dirname "$file")"
        case $file in
            *.xz) xz -dc "$modules/$file" >"$root/lib/modules/$version/${file%.xz}" ;;
            *) cp "$modules/$file" "$root/lib/modules/$version/$file" ;;
        esac
    done
done
"$busybox" depmod -b "$root" "$version"
(cd "$root" && find . | "$busybox" cpio -o -H newc 2>/dev/null | gzip -1) >"$work/initrd"

# KVM answers here and there and then hangs: the emulator's own processor always works. Its time goes on with its instructions:
# a busy machine makes it slow, never late
timeout "${CAN_VM_SECONDS:-600}" qemu-system-x86_64 -accel tcg -icount shift=0,sleep=on -m 768 -smp 1 -nodefaults -no-user-config -display none \
    -no-reboot -serial stdio -kernel "$kernel"/boot/vmlinuz-* -initrd "$work/initrd" \
    -virtfs local,path=/,mount_tag=hostroot,security_model=none,readonly=on,multidevs=remap \
    -append "console=ttyS0 quiet mitigations=off panic=-1 rig.folder=$folder rig.program=$program rig.python=$python" \
    </dev/null | sed -u 's/\r//' | tee "$work/said"
grep -qx "RESULT 0" "$work/said"
