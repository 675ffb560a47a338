#!/bin/bash
# An array of Slurm: each of eight tasks does an eighth of the list. OUT lies on a disk that all nodes see.
#
#   sbatch examples/batch/slurm.sh jobs.csv OUT
#
# A task that was cancelled, or ran out of time, goes on where it stopped when the same line is given again.
#SBATCH --job-name=planfit
#SBATCH --array=1-8
#SBATCH --cpus-per-task=4
#SBATCH --mem=16G
#SBATCH --time=08:00:00

set -u
planfit batch "$1" -o "$2" \
    --shard "${SLURM_ARRAY_TASK_ID}/${SLURM_ARRAY_TASK_COUNT}" \
    --workers "${SLURM_CPUS_PER_TASK}"
code=$?
# 1: some scans are not vouched for. That is a result, and no failure of the task.
if [ "$code" -eq 1 ]; then exit 0; fi
exit "$code"
