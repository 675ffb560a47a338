"""`planfit view` through its HTTP endpoints: who may ask, what is kept, and a scan placed by three picks."""

import http.client
import json
import socket
import struct
import threading
import tracemalloc
from dataclasses import asdict

import numpy as np
import pytest

import planfit
from builders import RoomFiles, position_rms_m, room_plan, room_scan
from planfit.corrections import read_corrections
from planfit.errors import OptionError, OutputError
from planfit.export.cloud import write_ply
from planfit.geometry import se3
from planfit.geometry.calibration import SensorCalibration
from planfit.pipeline.observations import extract_observations
from planfit.saving import save_result
from planfit.scan import read_tum
from planfit.scan.statistics import lift_pixel
from planfit.units import asked, told_in
from planfit.viewer import Session, ViewServer
from planfit.viewer.server import page
from test_corrections import HALF_TURN, walk_in_a_room


class Served:
    """A session behind a running server."""

    def __init__(self, session, server):
        self.session, self.server = session, server
        self.prefix = f"/{server.token}/"

    def ask(self, name, body=None, prefix=None, **headers):
        """Status, and JSON or bytes."""
        port = self.server.server_address[1]
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
        sent = {
            "Content-Type": "application/json",
            **{k.replace("_", "-"): v for k, v in headers.items()},
        }
        path = (self.prefix if prefix is None else prefix) + name
        if body is None:
            connection.request("GET", path, headers=headers)
        else:
            content = body if isinstance(body, bytes) else json.dumps(body).encode()
            connection.request("POST", path, content, sent)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        is_json = answer.getheader("Content-Type") == "application/json"
        return answer.status, json.loads(content) if is_json else content

    def add(self, kind, **entry):
        return self.ask("add", {"kind": kind, "entry": entry})


RECORD = {
    "inputs": {},
    "verdict": {
        "outcome": "refined",
        "predicted_error_rms_m": 0.02,
        "visits": [
            {
                "first_frames": [0, 3],
                "last_frames": [9, 11],
                "before_m": 0.1,
                "kept_out_m": m,
                "after_m": m,
            }
            for m in (0.01, 0.5)
        ],
    },
    "alignment": None,
    "plan_from_world_before": np.eye(4).tolist(),
    "matches": {"pairs_verified": 3, "loop_closures": 1},
    "keyframes": 12,
    "plan_faces": 4,
    "warnings": [],
    "corrections": None,
}


@pytest.fixture
def served(tmp_path):
    """A run folder as far as the page asks for it, with a solve that tells what it was given."""
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "run.json").write_text(json.dumps(RECORD))
    (folder / "report.html").write_text("<html><body><h1>report</h1></body></html>")
    owner = {"inputs": {}, "results": ["run.json", "report.html"]}
    (folder / ".planfit.json").write_text(json.dumps(owner))
    given = []
    release = threading.Event()

    def solve(corrections):
        release.wait(10)
        given.append(corrections)
        if len(corrections) > 3:
            raise OptionError("too many")
        record = {**RECORD, "keyframes": 12 - len(corrections)}
        (folder / "run.json").write_text(json.dumps(record))

    scan = room_scan(walk_in_a_room(12))
    session = Session(folder, scan, room_plan(), solve)
    with ViewServer(session) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        served = Served(session, server)
        served.given, served.release = given, release
        yield served
        release.set()
        session.wait()
        server.shutdown()
        thread.join()


def test_only_who_has_the_address_is_answered(served):
    assert served.server.server_address[0] == "127.0.0.1"
    assert len(served.server.token) >= 32
    assert served.ask("")[0] == 200
    wrong = "/" + "x" * len(served.server.token) + "/"
    for prefix in ("/", wrong, f"/{served.server.token[:-1]}/"):
        status, said = served.ask("state", prefix=prefix)
        assert status == 403
        assert said == b"open the address that planfit view printed"
        assert served.ask("add", {"kind": "add_loop", "entry": {}}, prefix=prefix)[0] == 403
    # A name that was made to lead here, and a page of elsewhere.
    assert served.ask("state", Host="elsewhere.example")[0] == 403
    for origin in ("http://elsewhere.example", "null"):  # a file, or a page that hides who it is
        assert served.ask("solve", {}, Origin=origin)[0] == 403
    assert not served.session.is_solving
    # A form of another page can send text, not JSON.
    assert served.ask("solve", {}, Content_Type="text/plain")[0] == 400
    assert not served.session.path.exists()


def test_page_images_and_state(served):
    status, page = served.ask("")
    assert status == 200
    assert b"<h1>report</h1>" in page
    assert page.index(b'id="hand"') < page.index(b"</body>")
    assert served.ask("frame/3")[1][:3] == b"\xff\xd8\xff"
    assert served.ask("frame/12")[1] == {"error": "expected a frame from 0 to 11, found 12"}
    for missing in ("frame/x", "frame/", "frame/" + "9" * 40, "../run.json", "run.json", "other"):
        assert served.ask(missing)[0] == 404
    state = served.ask("state")[1]
    assert state["frames"] == 12
    assert [visit["after_m"] for visit in state["visits"]] == [0.5, 0.01]
    plan = served.ask("plan")[1]
    assert np.shape(plan["faces"]) == (4, 2, 2)


def test_what_contradicts_what_is_told_with_what_takes_it_out(served):
    frames = {"first_frames": [0, 3], "last_frames": [9, 11], "face_idx": None, "ends": []}
    wall = {"first_frames": None, "last_frames": None, "face_idx": 0, "ends": [[0, 0], [6, 0]]}
    told = [
        {"item": {"kind": "loop", **frames}, "words": "loop"},
        {"item": {"kind": "loop by hand", **frames}, "words": "by hand"},
        {"item": {"kind": "wall", **wall}, "words": "wall"},
    ]
    record = {**RECORD, "verdict": {**RECORD["verdict"], "disagreements": told}}
    (served.session.folder / "run.json").write_text(json.dumps(record))
    loop, by_hand, wall = served.ask("state")[1]["disagreements"]
    assert (loop["words"], loop["frames"]) == ("loop", [0, 9])
    assert by_hand["correction"] is None  # it is in the list of corrections
    point = "control point 'C4' contradicts the other evidence"
    with_survey = {**record, "survey": {"contradicted": [point]}}
    (served.session.folder / "run.json").write_text(json.dumps(with_survey))
    of_point = served.ask("state")[1]["disagreements"][3]
    assert of_point == {"words": point, "frames": [], "correction": None}
    # What takes it out is taken as it is.
    for each in (loop, wall):
        assert served.ask("add", each["correction"])[0] == 200
    read = read_corrections(served.session.path)
    assert {each.kind for each in read} == {"delete_loop", "exclude_wall"}
    assert read.deleted[0].second == (9, 11)


def test_two_windows_on_one_folder_lose_nothing_of_each_other(served):
    """Each reads the file and writes it whole: what the other added meanwhile would be gone."""
    first = served.session
    other = Session(first.folder, first.scan, first.floorplan, first.solve)

    def add(session, frames):
        for k in frames:
            session.add("exclude_frames", {"frames": [k]})

    threads = [
        threading.Thread(target=add, args=(session, frames))
        for session, frames in ((first, range(6)), (other, range(6, 12)))
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    read = read_corrections(first.path).entries
    assert sorted(each.ranges[0][0] for each in read) == list(range(12))


def test_a_pair_that_the_walls_contradict_is_told_beside_it(served):
    """What the panel marks: only of the very pair that the run was made with."""
    served.add("place", frame=2, pixel=[30.0, 40.0], plan=[1.0, 1.0])
    served.add("place", frame=6, pixel=[100.0, 60.0], plan=[4.0, 1.0])
    words = [row["words"] for row in served.ask("state")[1]["corrections"]]
    reason = (
        "4.50 m off where the walls put it: without them 99% of the scanned wall lies on the plan"
    )
    used = [
        {
            "kind": "place",
            "number": 1,
            "words": words[0],
            "residual_m": 0.1,
            "contradicted": reason,
        },
        {
            "kind": "place",
            "number": 2,
            "words": "another",
            "residual_m": 0.1,
            "contradicted": reason,
        },
    ]
    record = {**RECORD, "corrections": {"used": used, "left_out": []}}
    (served.session.folder / "run.json").write_text(json.dumps(record))
    first, second = served.ask("state")[1]["corrections"]
    assert (first["contradicted"], first["is_solved"]) == (reason, True)
    assert (second["contradicted"], second["is_solved"]) == (None, False)


def test_a_point_of_the_cloud_is_told_its_pixel(served):
    scan = served.session.scan
    uv = (33.0, 71.0)
    point = lift_pixel(scan, 4, uv)
    assert served.ask("pixel", {"frame": 4, "point": point.tolist()}) == (200, {"pixel": [*uv]})
    # Half a metre before what its pixel shows: at an edge, or of another scan.
    before = point * (1 - 0.5 / np.linalg.norm(point))
    status, said = served.ask("pixel", {"frame": 4, "point": before.tolist()})
    assert status == 400
    assert "found the edge of something 0.50 m before or behind it" in said["error"]
    for wrong, words in (
        ({"frame": 12, "point": [0, 0, 1]}, "expected a frame from 0 to 11"),
        ({"frame": 4, "point": [0, 0]}, "expected 3 numbers for point"),
        ({"frame": 4, "point": [0, 0, float("nan")]}, "expected 3 numbers for point"),
        ({"frame": 4, "point": [9, 0, 1]}, "expected a pixel within 160 x 120"),
        ({"frame": 4, "point": [0, 0, -1]}, "expected a pixel within 160 x 120"),
    ):
        status, said = served.ask("pixel", wrong)
        assert status == 400
        assert words in said["error"]
    assert not served.session.path.exists()


def test_pixels_are_those_of_the_sensor_as_the_run_corrected_it(served):
    sensor = SensorCalibration(depth_scale=1.04, focal_scale=0.95, principal_x=0.02)
    record = {**RECORD, "sensor": {"correction": asdict(sensor)}}
    (served.session.folder / "run.json").write_text(json.dumps(record))
    uv = (120.0, 20.0)
    point = sensor.points(lift_pixel(served.session.scan, 4, uv)[None])[0]
    assert served.ask("pixel", {"frame": 4, "point": point.tolist()})[1] == {"pixel": [*uv]}
    served.add("place", frame=4, pixel=uv, plan=[1.5, 2])
    (row,) = served.ask("state")[1]["corrections"]
    assert row["mark"]["frame"] == 4
    np.testing.assert_allclose(row["mark"]["point"], point, atol=1e-4)
    assert row["mark"]["plan"] == row["mark"]["rim"] == [1.5, 2.0]


def test_every_correction_goes_to_the_file_at_once(served):
    assert served.add("add_loop", frames=[0, 11], pixels=[[20, 30], [40, 50.5]])[0] == 200
    assert served.add("delete_loop", frames=[[0, 3], [9, 11]])[0] == 200
    assert served.add("exclude_frames", frames=[[5, 6]])[0] == 200
    assert served.add("place", frame=2, pixel=[80, 60], plan=[1.5, 2])[0] == 200
    assert served.add("exclude_wall", ends=[[0, 0], [6, 0]], note="curtain")[0] == 200
    assert served.add("draw_wall", ends=[[2, 0], [2, 4]])[0] == 200
    status, state = served.add("erase_wall", ends=[[6, 4], [0, 4]])
    assert status == 200
    read = read_corrections(served.session.path)
    assert [each.words for each in read] == [row["words"] for row in state["corrections"]]
    assert {each.kind for each in read} == {
        "add_loop", "delete_loop", "exclude_frames", "place", "exclude_wall", "draw_wall", "erase_wall",
    }  # fmt: skip
    # One is taken out again, by what it says.
    loop = next(row for row in state["corrections"] if row["kind"] == "add_loop")
    assert served.ask("remove", loop)[0] == 200
    assert len(read_corrections(served.session.path)) == 6
    status, said = served.ask("remove", loop)
    assert status == 400
    assert "the list was changed elsewhere" in said["error"]
    # What is written there by hand meanwhile is kept.
    with served.session.path.open("a") as file:
        file.write("\n[[add_loop]]\nframes = [1, 10]\n")
    assert served.add("add_loop", frames=[2, 9])[0] == 200
    assert [each.frames for each in read_corrections(served.session.path).added] == [
        (1, 10),
        (2, 9),
    ]


@pytest.mark.parametrize(
    ("kind", "entry", "words"),
    [
        ("add_loop", {"frames": [0, 12]}, "expected frames from 0 to 11, found 12"),
        ("add_loop", {"frames": [0, 11], "pixels": [[200, 1], [1, 1]]}, "a pixel within 160 x 120"),
        ("erase_wall", {"ends": [[1, 1], [2, 1]]}, "expected a face from [1.0, 1.0]"),
        ("place", {"frame": 1, "pixel": [1, 1]}, "expected plan or plan_file"),
        ("wall", {}, "expected tables of corrections, found 'wall'"),
        ("add_loop", [], "expected a table for entry"),
        (3, {}, "expected words for kind"),
    ],
)
def test_a_wrong_correction_is_refused_and_not_kept(served, kind, entry, words):
    status, said = served.ask("add", {"kind": kind, "entry": entry})
    assert status == 400
    assert words in said["error"]
    assert not served.session.path.exists()


def test_requests_of_other_kinds_are_refused(served):
    assert served.ask("add", b"no JSON")[0] == 400
    assert served.ask("add", b"[1]")[0] == 400
    assert served.ask("add", b"{}", Content_Length="2000000")[0] == 400
    assert served.ask("other", {})[0] == 404


def test_who_goes_away_before_the_answer_leaves_no_word(served, capfd):
    """A reset instead of an orderly end: what is written to it fails."""
    port = served.server.server_address[1]
    for _ in range(20):
        asking = socket.create_connection(("127.0.0.1", port), timeout=30)
        asking.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        asking.sendall(b"GET /x HTTP/1.1\r\nHost: x\r\n")
        asking.close()
    assert served.ask("state")[0] == 200
    assert capfd.readouterr().err == ""


def test_what_no_browser_asks_is_answered_and_prints_nothing(served, capfd):
    """An address of no host, from whoever knows the port, and a number that is no float."""
    port = served.server.server_address[1]
    with socket.create_connection(("127.0.0.1", port), timeout=30) as asking:
        asking.sendall(b"GET http://[::1/x HTTP/1.1\r\nHost: x\r\n\r\n")
        assert asking.recv(12) == b"HTTP/1.1 403"
    many = b"9" * 400
    for body in (b'{"frame": 0, "point": [%s, 0, 0]}' % many, b'{"frame": %s}' % many):
        status, said = served.ask("pixel", body)
        assert (status, said) == (400, b"expected a JSON object of numbers below 1e18")
    host = f"localhost:{port}"
    assert served.ask("add", b"{}", Host=host, Origin=f"http://{host}")[0] == 400
    assert capfd.readouterr().err == ""


def test_a_damaged_file_is_told_and_left_as_it_is(served):
    served.session.path.write_text("[[add_loop")
    assert "expected TOML" in served.ask("state")[1]["failed"]
    assert served.add("add_loop", frames=[0, 11])[0] == 400
    assert served.session.path.read_text() == "[[add_loop"


def test_one_solve_at_a_time_with_what_the_file_says(served):
    served.add("add_loop", frames=[0, 11])
    status, state = served.ask("solve", {})
    assert (status, state["solving"]) == (200, True)
    status, said = served.ask("solve", {})
    assert status == 400
    assert "wait for it" in said["error"]
    served.release.set()
    served.session.wait()
    assert [each.frames for each in served.given[0].added] == [(0, 11)]
    state = served.ask("state")[1]
    assert state["changed"] == [["keyframes", "12", "11"]]
    for other in range(3):
        served.add("add_loop", frames=[0, 8 + other])
    served.ask("solve", {})
    served.session.wait()
    assert served.ask("state")[1]["failed"] == "too many"


def test_lengths_stay_in_the_units_that_were_asked_for(served, tmp_path):
    """Solves run in threads of their own."""
    units = []
    with told_in("ft"):
        session = Session(
            served.session.folder,
            served.session.scan,
            served.session.floorplan,
            lambda _: units.append(asked()),
        )
    with ViewServer(session) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        other = Served(session, server)
        other.ask("solve", {})
        session.wait()
        server.shutdown()
        thread.join()
    assert units == ["ft"]
    assert asked() == "m"


def test_a_page_that_asks_while_results_are_written_is_answered(served, monkeypatch):
    """The folder is locked then, by this very process."""
    served.add("exclude_frames", frames=[[5, 6]])
    served.ask("solve", {})

    def locked(_):
        raise OutputError("another process writes here")

    with monkeypatch.context() as patch:
        patch.setattr("planfit.viewer.session.finished_record", locked)
        status, state = served.ask("state")
        assert (status, state["solving"]) == (200, True)
        assert [visit["after_m"] for visit in state["visits"]] == [0.5, 0.01]
    served.release.set()
    served.session.wait()
    assert served.ask("state")[1]["changed"] == [["keyframes", "12", "11"]]


def test_a_port_that_is_taken_is_told(served):
    port = served.server.server_address[1]
    with pytest.raises(
        OptionError, match=f"--port: expected a free port, found one in use at {port}"
    ):
        ViewServer(served.session, port)
    with pytest.raises(OptionError, match="--port: expected 0 to 65535"):
        ViewServer(served.session, 70_000)


@pytest.mark.slow
def test_three_picks_place_a_scan_that_fits_in_two_ways(tmp_path, monkeypatch):
    """A rectangle fits when turned by half: placed wrongly at first, rightly once solved again."""
    walk = walk_in_a_room(12)
    scan, plan, folder = room_scan(walk), room_plan(), tmp_path / "out"
    monkeypatch.setattr(RoomFiles, "write_poses", lambda *_: None)  # it is of no format
    observations = extract_observations(scan)
    first = planfit.refine(scan, plan, observations=observations)
    truth = min(
        (walk, HALF_TURN @ walk), key=lambda poses: -position_rms_m(first.plan_from_cams, poses)
    )

    def solve(corrections):
        result = planfit.refine(scan, plan, observations=observations, corrections=corrections)
        save_result(result, folder)

    save_result(first, folder)
    with ViewServer(Session(folder, scan, plan, solve)) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        served = Served(server.session, server)
        for frame, uv in [(1, (30.0, 40.0)), (5, (100.0, 60.0)), (10, (80.0, 50.0))]:
            point = se3.transform(truth[frame], lift_pixel(scan, frame, uv)[None])[0]
            status, _ = served.add("place", frame=frame, pixel=uv, plan=point[:2].round(3).tolist())
            assert status == 200
        assert position_rms_m(read_tum(folder / "trajectory.tum")[1], truth) > 1.0
        assert served.ask("solve", {})[0] == 200
        served.session.wait(120)
        state = served.ask("state")[1]
        server.shutdown()
        thread.join()
    assert state["failed"] == ""
    assert position_rms_m(read_tum(folder / "trajectory.tum")[1], truth) < 0.08
    assert all(row["is_solved"] and row["residual_m"] < 0.1 for row in state["corrections"])
    assert "placed at" in [row[0] for row in state["changed"]]
    assert "3 corrections by hand: 3 places" in (folder / "report.html").read_text()
    assert (folder / "corrections.toml").exists()


def test_where_a_scan_was_dragged_to_is_kept_once(served):
    """Three pairs near its middle; dragged on, they replace the former ones, and no other place."""
    folder = served.session.folder
    poses = walk_in_a_room(12)
    rows = [[k, *pose[:3, 3], 0, 0, 0, 1] for k, pose in enumerate(poses)]
    np.savetxt(folder / "trajectory.tum", rows)
    status, shape = served.ask("shape")
    assert status == 200
    np.testing.assert_allclose(shape["points"], poses[:, :2, 3], atol=1e-3)  # no cloud: the way
    anchors = np.array([each["rim"] for each in shape["anchors"]])
    np.testing.assert_allclose(anchors.mean(axis=0), poses[:, :2, 3].mean(axis=0), atol=1e-3)
    off = np.linalg.norm(anchors - anchors.mean(axis=0), axis=1)
    np.testing.assert_allclose(off, shape["anchor_m"], atol=1e-3)
    cloud = np.column_stack([np.linspace(0, 5, 40), np.full(40, 4.0), np.full(40, 1.0)])
    write_ply(folder / "cloud_after.ply", cloud, np.zeros((40, 3), dtype=np.uint8))
    points = np.array(served.ask("shape")[1]["points"])
    assert np.abs(points[:, 1] - 4.0).max() < 0.1
    assert np.ptp(points[:, 0]) == pytest.approx(5.0, abs=0.2)

    served.add("place", scan=[0.0, 0.0, 1.0], plan=[1.0, 1.0])
    for by in (1.0, 2.0):
        pairs = [
            {"scan": each["scan"], "plan": [each["rim"][0] + by, each["rim"][1]]}
            for each in shape["anchors"]
        ]
        assert served.ask("drag", {"pairs": pairs})[0] == 200
        places = read_corrections(folder / "corrections.toml").places
        assert [place.note for place in places] == ["", *["dragged"] * 3]
        np.testing.assert_allclose(places[1].plan, pairs[0]["plan"])


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"pairs": []}, "expected tables for pairs"),
        ({"pairs": [3]}, "expected tables for pairs"),
        ({"pairs": [{"scan": [0, 0, 0]}]}, "this correction"),
        ({"pairs": [{"scan": [0, 0], "plan": [1, 2]}]}, "this correction"),
    ],
)
def test_what_is_no_pair_is_refused(served, body, words):
    status, told = served.ask("drag", body)
    assert (status, words in told["error"]) == (400, True), told
    assert not (served.session.folder / "corrections.toml").exists()


def test_a_cloud_of_another_program_is_not_read(served):
    folder = served.session.folder
    np.savetxt(folder / "trajectory.tum", [[0, 1, 1, 1, 0, 0, 0, 1]])
    (folder / "cloud_after.ply").write_bytes(b"ply\nformat ascii 1.0\n")
    status, told = served.ask("shape")
    assert status == 400
    assert "cloud_after.ply: expected a cloud as planfit writes it" in told["error"]


@pytest.mark.slow
@pytest.mark.parametrize(("off_m", "turn_deg"), [((0.5, -0.3), 0.0), ((0.3, 0.3), 12.0)])
def test_a_hand_may_be_off_by_half_a_metre_and_ten_degrees(off_m, turn_deg, tmp_path, monkeypatch):
    """The room that fits when turned by half, dragged to the other way round, and not well."""
    walk = walk_in_a_room(14)
    scan, plan, folder = room_scan(walk), room_plan(), tmp_path / "out"
    monkeypatch.setattr(RoomFiles, "write_poses", lambda *_: None)
    observations = extract_observations(scan)
    first = planfit.refine(scan, plan, observations=observations)
    truth = max(
        (walk, HALF_TURN @ walk), key=lambda poses: position_rms_m(first.plan_from_cams, poses)
    )
    save_result(first, folder)
    last = [first]

    def solve(corrections):
        last[0] = planfit.refine(scan, plan, observations=observations, corrections=corrections)

    session = Session(folder, scan, plan, solve)
    shape = session.shape()
    turn = np.deg2rad(180.0 + turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    anchors = np.array([each["rim"] for each in shape["anchors"]])
    middle = anchors.mean(axis=0)
    there = (HALF_TURN[:2, :2] @ middle + HALF_TURN[:2, 3]) + np.array(off_m)
    placed = (anchors - middle) @ rotation.T + there
    session.place_dragged(
        [
            {"scan": each["scan"], "plan": xy.tolist()}
            for each, xy in zip(shape["anchors"], placed, strict=True)
        ]
    )
    session.start_solve()
    session.wait(60)
    assert position_rms_m(last[0].plan_from_cams, truth) < 0.08


def test_a_large_report_is_held_twice_at_most():
    """96 MB of 10 million points took 0.56 GB as text, a sign of which no Latin alphabet has."""
    report = ("<html><head></head><body>" + "a\u2212" * 2_000_000 + "</body></html>").encode()
    tracemalloc.start()
    try:
        whole = page(report)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1.1 * len(whole)
    assert whole.startswith(b'<html><head><link rel="icon"')
    assert whole.endswith(b"</body></html>")
    assert whole.count(b"<script>") == 1


@pytest.mark.parametrize("report", [b"", b"<p>no head, no end"])
def test_a_report_without_head_and_end_has_the_panel_at_its_end(report):
    assert page(report).startswith(report)
    assert b"<script>" in page(report)
