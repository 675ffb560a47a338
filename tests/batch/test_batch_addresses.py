"""Scans at addresses, from real servers: what is copied is whole, and changes when the original does."""

import functools
import http.server
import itertools
import os
import threading
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from batch_results import write_results

from planfit.batch.addresses import staged
from planfit.batch.jobs import Job, stamp_of
from planfit.batch.ledger import End
from planfit.batch.process import Errand, perform
from planfit.errors import OptionError, ScanError

fsspec = pytest.importorskip("fsspec", reason="planfit[remote] is not installed")

FILES = {"color/0.png": b"0" * 1000, "color/1 ü.png": b"1" * 10, "poses.txt": b"1 2 3"}


class Bucket:
    """Files on a server, and how to change them."""

    def __init__(self, address, put):
        self.address, self._put = address, put
        for name, content in FILES.items():
            put(f"scans/office/{name}", content)
        put("plan.pdf", b"a plan")

    def put(self, name, content):
        self._put(name, content)


@pytest.fixture
def web(tmp_path):
    pytest.importorskip("aiohttp", reason="planfit[remote] is not installed")
    root = tmp_path / "web"
    root.mkdir()

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format, *args):
            pass

    handler = functools.partial(Quiet, directory=str(root))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()

    times = itertools.count(1_700_000_000, 10)  # web servers tell seconds

    def put(name, content):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        os.utime(path, times=(next(times),) * 2)

    yield Bucket(f"http://127.0.0.1:{server.server_port}", put)
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture
def s3(monkeypatch):
    server_of = pytest.importorskip("moto.server", reason="moto is not installed")
    pytest.importorskip("s3fs", reason="planfit[remote] is not installed")
    import boto3
    import s3fs

    server = server_of.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    endpoint = f"http://127.0.0.1:{server.get_host_and_port()[1]}"
    for name, value in {
        "AWS_ACCESS_KEY_ID": "testing", "AWS_SECRET_ACCESS_KEY": "testing", "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": endpoint, "FSSPEC_S3_ENDPOINT_URL": endpoint,
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    fsspec.config.conf.setdefault("s3", {})["endpoint_url"] = endpoint
    client = boto3.client("s3", endpoint_url=endpoint)
    client.create_bucket(Bucket="building")
    yield Bucket(
        "s3://building", lambda name, c: client.put_object(Bucket="building", Key=name, Body=c)
    )
    client.close()
    del fsspec.config.conf["s3"]["endpoint_url"]
    s3fs.S3FileSystem.clear_instance_cache()
    server.stop()


@pytest.fixture(params=["web", "s3"])
def bucket(request):
    return request.getfixturevalue(request.param)


def below(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_folder_is_copied_with_all_that_is_below(bucket, tmp_path):
    copy = staged(f"{bucket.address}/scans/office/", tmp_path / "cache")
    assert copy.name == "office"
    assert below(copy) == FILES


def test_a_file_is_copied(bucket, tmp_path):
    copy = staged(f"{bucket.address}/plan.pdf", tmp_path / "cache")
    assert copy.name == "plan.pdf"
    assert copy.read_bytes() == b"a plan"


def test_what_is_there_is_not_fetched_again_and_what_changed_is(bucket, tmp_path):
    address, cache = f"{bucket.address}/scans/office/", tmp_path / "cache"
    before, stamp = staged(address, cache), stamp_of(address)
    (before / "poses.txt").write_bytes(b"still mine")  # it would be overwritten
    assert staged(address, cache) == before
    assert (before / "poses.txt").read_bytes() == b"still mine"
    assert stamp_of(address) == stamp
    bucket.put("scans/office/poses.txt", b"4 5 6")
    assert stamp_of(address).digest != stamp.digest
    after = staged(address, cache)
    assert after != before
    assert below(after) == FILES | {"poses.txt": b"4 5 6"}
    assert stamp_of(address).n_files == 3


def test_a_copy_that_fails_leaves_nothing(bucket, tmp_path, monkeypatch):
    address, cache = f"{bucket.address}/scans/office/", tmp_path / "cache"
    system = fsspec.core.url_to_fs(address, use_listings_cache=False)[0]
    real = system.get_file

    def fails(path, target, **how):
        if path.endswith("poses.txt"):
            raise ConnectionResetError("the line is gone")
        return real(path, target, **how)

    monkeypatch.setattr(system, "get_file", fails)
    with pytest.raises(OSError, match="the line is gone"):
        staged(address, cache)
    assert {path.suffix for path in cache.iterdir()} == {".lock"}
    monkeypatch.setattr(system, "get_file", real)
    assert below(staged(address, cache)) == FILES


def test_half_a_file_is_no_copy(web, tmp_path, monkeypatch):
    address = f"{web.address}/plan.pdf"
    system = fsspec.core.url_to_fs(address, use_listings_cache=False)[0]
    monkeypatch.setattr(system, "get_file", lambda _, target: Path(target).write_bytes(b"a p"))
    with pytest.raises(OSError, match="expected 6 bytes, got 3"):
        staged(address, tmp_path / "cache")


def test_nothing_at_an_address(bucket, tmp_path):
    for name in ("none.pdf", "none/"):
        with pytest.raises(ScanError, match=r"none.*: expected a file or folder, found nothing"):
            staged(f"{bucket.address}/{name}", tmp_path / "cache")


def test_a_server_that_does_not_answer_may_later(tmp_path):
    pytest.importorskip("aiohttp", reason="planfit[remote] is not installed")
    with pytest.raises(OSError, match="the server does not answer"):
        staged("http://127.0.0.1:9/plan.pdf", tmp_path / "cache")


def test_a_kind_of_address_that_nobody_knows(tmp_path):
    with pytest.raises(OptionError, match="xyzzy://a: expected an address that fsspec knows"):
        staged("xyzzy://a", tmp_path / "cache")


def test_a_folder_inside_an_archive(tmp_path):
    with zipfile.ZipFile(tmp_path / "scans.zip", "w") as archive:
        for name, content in FILES.items():
            archive.writestr(f"office/{name}", content)
    copy = staged(f"zip://office::file://{tmp_path}/scans.zip", tmp_path / "cache")
    assert copy.name == "office"
    assert below(copy) == FILES


def test_names_that_lead_elsewhere_are_left_out(s3, tmp_path):
    s3.put("evil/a/../../../x", b"not here")
    s3.put("evil/.../y", b"dots are a name")
    copy = staged(f"{s3.address}/evil/", tmp_path / "a" / "b" / "c" / "cache")
    assert below(copy) == {".../y": b"dots are a name"}
    assert not list(tmp_path.rglob("x"))


def test_without_the_library_it_is_said(monkeypatch, tmp_path):
    monkeypatch.setitem(__import__("sys").modules, "fsspec.core", None)
    with pytest.raises(OptionError, match=r"planfit\[remote\]"):
        staged("s3://a/b", tmp_path / "cache")


def test_copies_of_two_at_once_are_one(web, tmp_path):
    address, cache = f"{web.address}/scans/office/", tmp_path / "cache"
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(staged(address, cache))) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    assert len(set(found)) == 1
    assert not list(cache.glob("*.part"))


def test_a_job_at_an_address_is_done_once_and_again_when_it_changes(ledger, tmp_path):
    def pack(text):
        with zipfile.ZipFile(tmp_path / "scans.zip", "w") as archive:
            archive.writestr("office/0.png", text)
        fsspec.get_filesystem_class(
            "zip"
        ).clear_instance_cache()  # each job has a process of its own

    calls = []

    def refine(words, inputs):
        calls.append((Path(words[0]), inputs))
        write_results(ledger.folder("a"), {"scan": words[0], **inputs}, "--overwrite" in words)

    pack("one")
    scan = f"zip://office::file://{tmp_path}/scans.zip"
    errand = Errand(Job("a", scan, (f"0={scan}",)), str(ledger.out))
    assert perform(errand, refine).end is End.DONE
    assert perform(errand, refine).end is End.DONE
    ((copy, inputs),) = calls
    assert below(copy) == {"0.png": b"one"}
    assert ledger.staged in copy.parents
    assert (inputs["scan_address"], inputs["plan_address"]) == (scan, f"0={scan}")
    pack("two and more")
    assert perform(errand, refine).end is End.DONE
    assert below(calls[1][0]) == {"0.png": b"two and more"}
    away = replace(errand, job=Job("b", "zip://none::file:///none.zip"))
    assert perform(away, refine).end is End.REFUSED
