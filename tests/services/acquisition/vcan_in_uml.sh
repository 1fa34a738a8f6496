#!/usr/bin/env bash
# vcan_in_uml.sh [options] -- command [args...]
# Runs one command inside a User-Mode-Linux guest (an ordinary host process, no root, no KVM)
# whose kernel has real SocketCAN vcan interfaces. The guest's root is the host's own file
# system, read-only, through hostfs, so the host's Python/venv is used as is.
#   -m MEM      guest memory (default 512M)      -n N     number of vcan interfaces (default 2)
#   -w DIR      directory writable in the guest (repeatable, host path = guest path)
#   -t SEC      wall limit (default 300)         -v       show the kernel's console
# Exit status = the command's (124 = ran past the limit, 125 = guest did not come up).
set -u
MEM=512M NV=2 LIM=300 VERB=0 RW=()
while getopts "m:n:w:t:v" o; do case $o in
  m) MEM=$OPTARG;; n) NV=$OPTARG;; w) RW+=("$(readlink -f "$OPTARG")");; t) LIM=$OPTARG;; v) VERB=1;; *) exit 2;; esac; done
shift $((OPTIND-1)); [ "${1-}" = -- ] && shift
[ $# -gt 0 ] || { sed -n 2,11p "$0"; exit 2; }
CACHE=${VCAN_UML_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/vcan-uml}
if [ ! -x "$CACHE/usr/bin/linux.uml" ]; then           # 40 MB, once; no install, no root needed
  mkdir -p "$CACHE" && ( cd "$CACHE" && apt-get download user-mode-linux >&2 && dpkg -x user-mode-linux_*.deb . ) || exit 125
fi
KV=$(ls "$CACHE/usr/lib/uml/modules" | head -1); MOD=$CACHE/usr/lib/uml/modules/$KV/kernel
W=$(mktemp -d "${TMPDIR:-/tmp}/vcanuml.XXXXXX"); P=
cleanup() { local g; g=$(cat "$W/g/pid" 2>/dev/null) && kill -KILL -- "-$g" 2>/dev/null   # the guest makes its own session
  [ -n "$P" ] && kill -KILL "$P" 2>/dev/null; kill ${T1-} ${T2-} 2>/dev/null; sleep 0.3; rm -rf "$W"; }
trap cleanup EXIT; trap 'exit 143' TERM INT HUP
export -p | grep -vE ' (PWD|OLDPWD|TMPDIR|SHLVL|_)=' > "$W/env"
printf '%q ' "$@" > "$W/cmd"
cat > "$W/init" <<INIT
#!/bin/bash
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc; mount -t sysfs sys /sys
mkdir -p /dev/pts /dev/shm; mount -t devpts devpts /dev/pts; mount -t tmpfs tmpfs /dev/shm
# Without kmod's insmod: system call finit_module (313 on amd64) through perl, which every Debian has.
insert() { if command -v insmod > /dev/null; then insmod "\$1"; else
  perl -e 'open F, "<", \$ARGV[0] or die; my \$none = ""; syscall(313, fileno(F), \$none, 0) == 0 or die "\$ARGV[0]: \$!\n"' "\$1"; fi; }
ln -sf /proc/self/fd /dev/fd; ln -sf /proc/self/fd/1 /dev/stdout; ln -sf /proc/self/fd/2 /dev/stderr
mount -t tmpfs tmpfs /run; mkdir -p /run/tmp /run/o
mount -t hostfs -o $W none /run/o
for d in ${RW[*]-}; do mount -t hostfs -o \$d none \$d; done
for k in drivers/net/can/dev/can-dev net/can/can net/can/can-raw net/can/can-bcm drivers/net/can/vcan; do insert $MOD/\$k.ko || exit; done
ip link set lo up
for i in \$(seq 0 $((NV-1))); do ip link add dev vcan\$i type vcan && ip link set vcan\$i mtu 72 up; done
. /run/o/env; export TMPDIR=/run/tmp PYTHONDONTWRITEBYTECODE=1
cut -d' ' -f1 /proc/uptime > /run/o/up
cd $PWD && eval "\$(cat /run/o/cmd)" < /dev/null > /run/o/out 2> /run/o/err
echo \$? > /run/o/rc; sync
echo o > /proc/sysrq-trigger; sleep 5
INIT
chmod 755 "$W/init"; : > "$W/out"; : > "$W/err"
tail -q -n +1 -f "$W/out" 2>/dev/null & T1=$!; tail -q -n +1 -f "$W/err" >&2 2>/dev/null & T2=$!
UML_ARGS=(mem=$MEM rootfstype=hostfs rootflags=/ ro root=/dev/root init="$W/init" con=null ssl=null con0=fd:0,fd:1 uml_dir="$W" umid=g quiet)
timeout --foreground -k 5 "$LIM" "$CACHE/usr/bin/linux.uml" "${UML_ARGS[@]}" < /dev/null > "$W/console" 2>&1 &
P=$!; wait $P; S=$?
sleep 0.2; kill $T1 $T2 2>/dev/null; wait 2>/dev/null; 
[ $VERB = 1 ] && cat "$W/console" >&2
[ -f "$W/up" ] && [ -n "${VCAN_UML_TIMES-}" ] && echo "guest up after $(cat "$W/up") s" >&2
if [ -s "$W/rc" ]; then exit "$(cat "$W/rc")"; fi
[ $S = 124 ] || [ $S = 137 ] && exit 124
cat "$W/console" >&2; exit 125
