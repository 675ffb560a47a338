"""What memory there is, in containers too, and what a job is expected to need."""

import pytest

from planfit.batch.jobs import Stamp
from planfit.batch.memory import GB, Expectation, free_bytes, guess_bytes, own_peak_bytes


def system(tmp_path, files):
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


MEMINFO = "MemTotal: 16000000 kB\nMemAvailable:  8000000 kB\n"


def test_without_groups_what_the_system_can_give(tmp_path):
    assert free_bytes(system(tmp_path, {"proc/meminfo": MEMINFO})) == 8_000_000 * 1024


def test_a_limit_of_a_group_above_counts(tmp_path):
    root = system(
        tmp_path,
        {
            "proc/meminfo": MEMINFO,
            "proc/self/cgroup": "0::/slurm/job_1/step\n",
            "sys/fs/cgroup/slurm/job_1/step/memory.max": "max\n",
            "sys/fs/cgroup/slurm/job_1/step/memory.current": "5\n",
            "sys/fs/cgroup/slurm/job_1/memory.max": f"{4 * GB}\n",
            "sys/fs/cgroup/slurm/job_1/memory.current": f"{3 * GB}\n",
            "sys/fs/cgroup/slurm/job_1/memory.stat": f"anon 7\ninactive_file {GB}\n",
        },
    )
    assert free_bytes(root) == 2 * GB  # files that were read are given back


def test_groups_of_the_first_version(tmp_path):
    root = system(
        tmp_path,
        {
            "proc/meminfo": MEMINFO,
            "proc/self/cgroup": "5:cpu,cpuacct:/a\n4:memory:/docker/1\n",
            "sys/fs/cgroup/memory/docker/1/memory.limit_in_bytes": f"{2 * GB}\n",
            "sys/fs/cgroup/memory/docker/1/memory.usage_in_bytes": f"{3 * GB}\n",
        },
    )
    assert free_bytes(root) == 0


def test_a_system_that_does_not_tell(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.platform", "win32")
    assert free_bytes(tmp_path) is None


def test_this_machine_tells_something_sensible():
    free, peak = free_bytes(), own_peak_bytes()
    if free is None or peak is None:
        pytest.skip("this system tells neither free memory nor peaks")
    assert 10 * 10**6 < free < 10**14
    assert 20 * 10**6 < peak < 10**12


def test_what_is_expected():
    small, large = Stamp("", 100, 10**7), Stamp("", 40_000, 10**10)
    bag = Stamp("", 1, 10**9)
    assert guess_bytes(small) < guess_bytes(large)
    assert guess_bytes(bag) == pytest.approx(3.6 * GB, rel=0.1)
    expected = Expectation()
    assert expected.of(small, None, None) == guess_bytes(small)
    assert expected.of(small, 7.0, 10**9) == 7 * GB  # the user knows
    assert expected.of(small, None, 10**9) == pytest.approx(1.15 * GB)
    expected.learn(small, guess_bytes(small) // 2)
    assert expected.of(large, None, None) == guess_bytes(large)  # never less than guessed
    expected.learn(small, guess_bytes(small) + GB)
    assert expected.of(large, None, None) > guess_bytes(large) + GB
