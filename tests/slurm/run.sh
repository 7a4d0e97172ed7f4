#!/usr/bin/env bash
# A study on a real Slurm of two nodes, one of which dies in the middle: the merged result must be that of a local run,
# to the byte.
#   tests/slurm/run.sh PROGRAM
# Needs root, and Debian's slurmctld, slurmd, slurm-client and munge; everything stays on the loopback interface.
set -euo pipefail
program=$(realpath "$1")
work=$(mktemp -d)
export SLURM_CONF=$work/slurm.conf
host=$(hostname -s)
study=(methods --quick --seeds "${SEEDS:-4}")
shards=8

stop() {
    pkill -9 -f "slurm.*$work" || true
    for file in "$work"/*.pid; do [ -f "$file" ] && kill -9 "$(cat "$file")" 2>/dev/null || true; done
    rm -rf "$work"
}
trap stop EXIT

fail() {
    printf 'FAILED: %s\n' "$1"
    tail -n 20 "$work"/logs/* "$work"/queued/*.log 2>/dev/null || true
    exit 1
}

wait_for() { # SECONDS WHAT COMMAND...
    local until=$((SECONDS + $1)) what=$2
    shift 2
    until "$@" >/dev/null 2>&1; do
        [ $SECONDS -lt $until ] || fail "$what"
        sleep 0.5
    done
}

mkdir -p "$work"/{munge,state,logs}
chmod 700 "$work/munge"
head -c 1024 /dev/urandom >"$work/munge/key"
chmod 400 "$work/munge/key"
munged --force --key-file "$work/munge/key" --socket "$work/munge/socket" --pid-file "$work/munged.pid" \
    --log-file "$work/logs/munged.log" --seed-file "$work/munge/seed"

cat >"$SLURM_CONF" <<CONF
ClusterName=study
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket
CredType=cred/munge
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
SlurmctldPort=16817
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool.%n
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.%n.pid
SlurmctldLogFile=$work/logs/slurmctld.log
SlurmdLogFile=$work/logs/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_min_interval=100000,batch_sched_delay=0
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
ReturnToService=2
SlurmctldTimeout=10
SlurmdTimeout=10
NodeName=n[1-2] NodeHostname=$host NodeAddr=127.0.0.1 Port=[16821-16822] CPUs=1 RealMemory=500 State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
slurmctld -c
slurmd -N n1
slurmd -N n2
wait_for 30 "the nodes do not come up" sh -c '[ "$(sinfo -h -o %T)" = idle ]'

"$program" study "${study[@]}" --out "$work/local" >/dev/null
"$program" study submit "${study[@]}" --engine slurm --shards $shards --out "$work/queued"
sh "$work/queued/submit.sh"

of_lost() { pkill "$1" -f "study run methods.*--shard $lost/$shards"; }
# a shard that runs on the second node while another has its result: held before it is asked whether it is done
held_on_n2() {
    lost=$(squeue -h -w n2 -t R -o %K)
    [ -n "$lost" ] && [ -f "$work/queued/shard-00001-of-0000$shards.json" ] && of_lost -STOP || return 1
    [ ! -f "$work/queued/shard-0000$lost-of-0000$shards.json" ] || { of_lost -CONT; return 1; }
}
wait_for 120 "no shard runs on the second node" held_on_n2
kill -9 "$(cat "$work/slurmd.n2.pid")"
pkill -9 -f "slurmstepd.*" || true
of_lost -9 || true
echo "the node of shard $lost is dead"

requeued() { scontrol show job | grep -q "Restarts=[1-9]"; }
wait_for 120 "the shard of the dead node is not put back into the queue" requeued
# Slurm lets such a job wait for two minutes; the outcome does not depend on it
now() { for job in $(squeue -h -t PD -o %A); do scontrol update JobId="$job" StartTime=now 2>/dev/null || true; done; }
finished() { now; [ -z "$(squeue -h -o %A)" ]; }
wait_for 300 "the queue does not empty" finished
[ -f "$work/queued/report.html" ] || fail "the shards were not merged"
for file in rows.csv findings.json truth-paper-os1-64-lateral.csv; do
    cmp "$work/local/$file" "$work/queued/$file" || fail "$file differs from the local run"
done
echo "$shards shards on two nodes, one of them lost: the result is that of one machine"
