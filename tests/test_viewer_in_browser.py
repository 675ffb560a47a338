"""`planfit view` as a person uses it, in Chromium: what is wrong is right once corrected and solved again."""

import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

import planfit
from builders import RoomFiles, faces_plan, position_rms_m, room_plan, room_scan
from driven_browser import driven_browser, needs_browser, set_size
from planfit.corrections import read_corrections
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.disagreements import Disagreement, EvidenceItem
from planfit.pipeline.observations import extract_observations
from planfit.saving import save_result
from planfit.scan import read_tum
from planfit.viewer import Session, ViewServer
from test_corrections import HALF_TURN, drifted_room, end_error_m, picked, walk_in_a_room

pytest.importorskip("selenium.webdriver", reason="no selenium to drive a browser with")
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

pytestmark = needs_browser
__all__ = ["drifted_room"]  # a fixture


@pytest.fixture(scope="module")
def browser():
    with driven_browser() as driver:
        yield driver


class Panel:
    """The page of `planfit view`."""

    def __init__(self, browser, server, size):
        self.browser, self.server = browser, server
        set_size(browser, *size)
        browser.get(server.address)
        self.wait_until_ready()

    def wait_for(self, condition, seconds=60):
        end = time.monotonic() + seconds
        while not self.browser.execute_script(f"return {condition}"):
            assert time.monotonic() < end, f"{condition}: {self.browser.get_log('browser')}"
            time.sleep(0.05)

    def wait_until_ready(self):
        self.wait_for("document.getElementById('hand')?.dataset.ready === '1'")
        self.wait_for(
            "[...document.querySelectorAll('.hand-picture img')].every((i) => i.naturalWidth)"
        )

    def find(self, name):
        return self.browser.find_element(By.CSS_SELECTOR, name)

    def press(self, selector, x=None, y=None):
        """The middle of something, or px from its upper left."""
        found = self.find(selector)
        self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", found)
        actions = ActionChains(self.browser)
        if x is None:
            actions.move_to_element(found)
        else:
            rim = self.browser.execute_script(
                "const r = arguments[0].getBoundingClientRect(); return [r.left, r.top]", found
            )
            actions.w3c_actions.pointer_action.move_to_location(
                round(rim[0] + x), round(rim[1] + y)
            )
        actions.click().perform()

    def press_pixel(self, letter, uv):
        """A pixel of the image of frame A or B."""
        picture = f"#hand figure:nth-child({1 + 'AB'.index(letter)}) .hand-picture"
        width, natural = self.browser.execute_script(
            "const i = document.querySelector(arguments[0] + ' img'); return [i.clientWidth, i.naturalWidth]",
            picture,
        )
        self.press(picture, *((np.array(uv) + 0.5) * width / natural))

    def show(self, letter, frame):
        self.browser.execute_script(
            "const i = document.querySelector(arguments[0]); i.value = arguments[1];"
            "i.dispatchEvent(new Event('change'))",
            f".hand-{letter.lower()}", frame,
        )  # fmt: skip
        self.wait_until_ready()

    def press_cloud(self, point_plan):
        """Where a point (m, plan frame) is drawn in the 3D view."""
        at = self.browser.execute_script(
            "return document.getElementById('view').view.drawnAt(arguments[0])", list(point_plan)
        )
        self.press(".view-stage canvas", *at)

    def press_plan(self, xy):
        """A point of the plan, on its map."""
        at = self.browser.execute_script(
            "const svg = document.querySelector('.hand-plan svg'), m = svg.getScreenCTM();"
            "const p = new DOMPoint(arguments[0], -arguments[1]).matrixTransform(m);"
            "const r = svg.getBoundingClientRect(); return [p.x - r.left, p.y - r.top]",
            *xy,
        )
        self.press(".hand-plan svg", *at)

    def drag_plan(self, xy, by_m):
        """From a point of the plan on its map."""
        svg = self.find(".hand-plan svg")
        self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", svg)
        ends = [
            self.browser.execute_script(
                "const m = arguments[0].getScreenCTM();"
                "const p = new DOMPoint(arguments[1], -arguments[2]).matrixTransform(m); return [p.x, p.y]",
                svg, *map(float, at),
            )
            for at in (xy, np.add(xy, by_m))
        ]  # fmt: skip
        actions = ActionChains(self.browser)
        pointer = actions.w3c_actions.pointer_action
        pointer.move_to_location(*map(round, ends[0])).pointer_down()
        for share in (0.3, 0.7, 1.0):
            at = np.array(ends[0]) + share * np.subtract(ends[1], ends[0])
            pointer.move_to_location(*(round(float(v)) for v in at))
        pointer.pointer_up()
        actions.perform()

    @property
    def status(self):
        return self.find(".hand-status").text

    def solve(self):
        self.press(".hand-solve")
        self.server.session.wait(120)
        self.wait_for("!document.querySelector('.hand-changed')?.hidden")
        self.wait_until_ready()


@contextmanager
def served(session):
    with ViewServer(session) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:
            session.wait()
            server.shutdown()
            thread.join()


def refined_poses(folder):
    return read_tum(folder / "trajectory.tum")[1]


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1200, 900), (390, 844)])
def test_three_pairs_of_points_place_a_room_that_fits_in_two_ways(
    browser, tmp_path, monkeypatch, size
):
    """A rectangle fits when turned by half: corners of the cloud are pressed, then those of the plan."""
    walk = walk_in_a_room(14)
    scan, plan, folder = room_scan(walk), room_plan(), tmp_path / "out"
    monkeypatch.setattr(RoomFiles, "write_poses", lambda *_: None)  # it is of no format
    observations = extract_observations(scan)
    first = planfit.refine(scan, plan, observations=observations)
    truth = max(
        (walk, HALF_TURN @ walk), key=lambda poses: position_rms_m(first.plan_from_cams, poses)
    )
    save_result(first, folder)

    def solve(corrections):
        save_result(
            planfit.refine(scan, plan, observations=observations, corrections=corrections), folder
        )

    with served(Session(folder, scan, plan, solve)) as server:
        page = Panel(browser, server, size)
        page.press(".hand-pairs")
        page.press(".view-above")
        n_placed = 0
        for x, y in [(0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)]:
            page.press_cloud((x, y, 1.0))
            page.wait_for("document.querySelector('.hand-status').textContent")
            page.wait_for("!document.querySelector('.hand-status').textContent.includes('press a')")
            time.sleep(0.5)
            if "on the plan" not in page.status:
                continue  # the walk did not see this corner
            page.press_plan((6.0 - x, 4.0 - y + 0.03))  # a little beside; the corner takes it
            n_placed += 1
            page.wait_for(f"document.querySelectorAll('.hand-list li').length === {n_placed}")
            if n_placed == 3:
                break
        assert n_placed == 3
        places = read_corrections(folder / "corrections.toml").places
        assert all(np.isin(place.plan[0], [0.0, 6.0]) for place in places)
        assert "solve again" in page.status
        assert len(browser.find_elements(By.CSS_SELECTOR, ".hand-over text")) == 3
        assert browser.execute_script("return document.documentElement.scrollWidth") <= size[0]
        assert position_rms_m(refined_poses(folder), truth) > 1.0
        page.solve()
        assert position_rms_m(refined_poses(folder), truth) < 0.08
        rows = [li.text for li in browser.find_elements(By.CSS_SELECTOR, ".hand-list li")]
        assert all("used, 0.0" in row for row in rows), rows
        assert browser.get_log("browser") == []


@pytest.mark.slow
def test_a_loop_pressed_in_two_images_closes_a_drifted_walk(
    browser, tmp_path, monkeypatch, drifted_room, rng
):
    """Half a metre of drift that nothing else closes."""
    true, scan, observations = drifted_room
    monkeypatch.setattr(RoomFiles, "write_poses", lambda *_: None)
    folder = tmp_path / "out"
    first = planfit.refine(scan, None, observations=observations)
    save_result(first, folder)
    last = [first]

    def solve(corrections):
        last[0] = planfit.refine(scan, None, observations=observations, corrections=corrections)
        save_result(last[0], folder)

    ((uv_a, uv_b),) = picked(scan, true, 1, 22, rng, 1)
    with served(Session(folder, scan, None, solve)) as server:
        page = Panel(browser, server, (1200, 900))
        assert not page.find(".hand-pairing").is_displayed()  # no plan to place it on
        page.show("A", 1)
        page.show("B", 22)
        page.press_pixel("A", uv_a)
        page.press_pixel("B", uv_b)
        page.press(".hand-add")
        page.wait_for("document.querySelectorAll('.hand-list li').length === 1")
        (loop,) = read_corrections(folder / "corrections.toml").added
        assert loop.frames == (1, 22)
        np.testing.assert_allclose(loop.pixels, [uv_a, uv_b], atol=0.6)
        before = end_error_m(last[0], true)
        page.solve()
        assert before > 0.3
        assert end_error_m(last[0], true) < 0.5 * before
        assert "m apart in the result" in page.find(".hand-list li").text
        changed = page.find(".hand-changed").text
        assert "loop closures" in changed or "matched pairs" in changed or "predicted" in changed
        # Taken out again, nothing is left of it. It is told on the screen, far below the panel's head.
        set_size(browser, 1200, 500)
        page.press(".hand-list li button")
        page.wait_for("document.querySelectorAll('.hand-list li').length === 0")
        page.wait_for("document.querySelector('.hand-status').textContent === 'taken out'")
        top, bottom = browser.execute_script(
            "const status = document.querySelector('.hand-status');"
            "const { top, bottom } = status.getBoundingClientRect(); return [top, bottom]"
        )
        assert 0 <= top < bottom <= 500
        assert len(read_corrections(folder / "corrections.toml")) == 0
        assert browser.get_log("browser") == []


HALF_M = 6.4
"""From one half of the building to the other, which is its mirror image."""


def mirrored_halves():
    """Two rooms with a pier at the middle of their south walls, mirrored about the wall between them: a scan
    of one fits the other as well."""
    half = [[0, 0], [2.4, 0], [2.4, 0.6], [3.6, 0.6], [3.6, 0], [6, 0], [6, 4], [0, 4]]
    west = faces_plan(half)
    other = [[6.0 + HALF_M - x, y] for x, y in half[::-1]]
    east = faces_plan(other)
    return replace(
        west,
        ends=np.concatenate([west.ends, east.ends]),
        normals=np.concatenate([west.normals, east.normals]),
        is_oriented=np.ones(16, dtype=bool),
    )


def by_pairs(page, shift_m):
    """Three corners of the cloud, pressed in 3D and on the plan."""
    page.press(".hand-pairs")
    page.press(".view-above")
    n_placed = 0
    for x, y in [(0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)]:
        page.press_cloud((x + (HALF_M if shift_m < 0 else 0.0), y, 1.0))
        page.wait_for("document.querySelector('.hand-status').textContent")
        page.wait_for("!document.querySelector('.hand-status').textContent.includes('press a')")
        time.sleep(0.5)
        if "on the plan" not in page.status:
            continue
        page.press_plan((x + (HALF_M if shift_m > 0 else 0.0), y))
        n_placed += 1
        page.wait_for(f"document.querySelectorAll('.hand-list li').length === {n_placed}")
        if n_placed == 3:
            return


def by_drag(page, shift_m):
    """By a mouse, 0.3 m beside its place, and turned by hand by some degrees."""
    page.drag_plan((3.0 if shift_m > 0 else 3.0 + HALF_M, 2.0), (shift_m + 0.3, 0.2))
    page.wait_for("document.querySelectorAll('.hand-list li').length === 3")
    page.find(".hand-plan svg").send_keys("]]]")
    time.sleep(1.0)  # the list is written anew after each, and what is below it moves


def by_keys(page, shift_m):
    """By arrow keys, a metre a press with shift."""
    key = Keys.ARROW_RIGHT if shift_m > 0 else Keys.ARROW_LEFT
    for _ in range(6):
        ActionChains(page.browser).key_down(Keys.SHIFT).send_keys(key).key_up(Keys.SHIFT).perform()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "size"),
    [
        (by_pairs, (1200, 900)),
        (by_drag, (1200, 900)),
        (by_drag, (390, 844)),
        (by_keys, (1200, 900)),
    ],
)
def test_a_scan_in_the_mirrored_half_of_a_building_is_brought_to_its_own(
    browser, tmp_path, monkeypatch, way, size
):
    """Nothing but a person knows in which half the scan was made: planfit takes one, and it is the other."""
    walk = walk_in_a_room(14)
    pier = ([2.4, 0.0, 0.0], [3.6, 0.6, 2.6])
    scan, plan, folder = room_scan(walk, boxes=[pier]), mirrored_halves(), tmp_path / "out"
    monkeypatch.setattr(RoomFiles, "write_poses", lambda *_: None)
    observations = extract_observations(scan)
    first = planfit.refine(scan, plan, observations=observations)
    shift = se3.make_transform(np.eye(3), np.array([HALF_M, 0.0, 0.0]))
    truth = max((walk, shift @ walk), key=lambda poses: position_rms_m(first.plan_from_cams, poses))
    save_result(first, folder)

    def solve(corrections):
        save_result(
            planfit.refine(scan, plan, observations=observations, corrections=corrections), folder
        )

    with served(Session(folder, scan, plan, solve)) as server:
        page = Panel(browser, server, size)
        if way is not by_pairs:
            page.press(".hand-drag")
            page.wait_for("document.querySelectorAll('.hand-scan path').length === 1")
        assert position_rms_m(refined_poses(folder), truth) > 5.0
        way(page, HALF_M if truth[0, 0, 3] > 6.0 else -HALF_M)
        page.wait_for("document.querySelectorAll('.hand-list li').length === 3")
        places = read_corrections(folder / "corrections.toml").places
        assert len(places) == 3
        assert browser.execute_script("return document.documentElement.scrollWidth") <= size[0]
        page.solve()
        assert position_rms_m(refined_poses(folder), truth) < 0.08
        rows = [li.text for li in browser.find_elements(By.CSS_SELECTOR, ".hand-list li")]
        assert all("used" in row for row in rows), rows
        assert browser.get_log("browser") == []


@pytest.mark.slow
def test_two_fingers_and_the_handle_turn_a_scan(browser, tmp_path, monkeypatch):
    """On a phone; by a quarter turn to the right, then back by the handle."""
    walk = walk_in_a_room(14)
    scan, plan, folder = room_scan(walk), room_plan(), tmp_path / "out"
    monkeypatch.setattr(RoomFiles, "write_poses", lambda *_: None)
    save_result(planfit.refine(scan, plan, observations=extract_observations(scan)), folder)

    def touch(kind, *fingers):
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(fingers)]
        browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def placed():
        places = read_corrections(folder / "corrections.toml").places
        return np.array([place.plan for place in places])

    with served(Session(folder, scan, plan, lambda _: None)) as server:
        page = Panel(browser, server, (390, 844))
        page.press(".hand-drag")
        page.wait_for("document.querySelectorAll('.hand-scan path').length === 1")
        page.find(".hand-plan svg").send_keys(Keys.ARROW_LEFT, Keys.ARROW_RIGHT)
        page.wait_for("document.querySelectorAll('.hand-list li').length === 3")
        before = placed()
        middle = before.mean(axis=0)
        x, y = browser.execute_script(
            "document.querySelector('.hand-plan svg').scrollIntoView({block: 'center'});"
            "const r = document.querySelector('.hand-plan svg').getBoundingClientRect();"
            "return [r.left + r.width / 2, r.top + r.height / 2]"
        )
        touch("touchStart", (x - 40, y), (x + 40, y))
        for angle in np.deg2rad([30, 60, 90]):
            c, s = 40 * np.cos(angle), 40 * np.sin(angle)
            touch("touchMove", (x - c, y - s), (x + c, y + s))
        touch("touchEnd")
        time.sleep(0.3)
        turned = (before - middle) @ np.array([[0.0, -1.0], [1.0, 0.0]])  # to the right
        np.testing.assert_allclose(placed() - placed().mean(axis=0), turned, atol=0.1)
        np.testing.assert_allclose(placed().mean(axis=0), middle, atol=0.15)
        # The handle stands to the right now; a quarter of a circle about the middle of the scan.
        at = browser.execute_script(
            "const r = document.querySelector('.hand-handle').getBoundingClientRect();"
            "const m = document.querySelector('.hand-plan svg').getScreenCTM();"
            "const c = new DOMPoint(arguments[0], -arguments[1]).matrixTransform(m);"
            "return [r.left + r.width / 2, r.top + r.height / 2, c.x, c.y]",
            *map(float, placed().mean(axis=0)),
        )
        assert at[0] > at[2] + 20
        touch("touchStart", (at[0], at[1]))
        touch("touchMove", (at[2] + 25, at[3] - 25))
        touch("touchMove", (at[2], at[3] - 36))
        touch("touchEnd")
        time.sleep(0.3)
        np.testing.assert_allclose(placed(), before, atol=0.2)
        assert len(placed()) == 3
        assert browser.get_log("browser") == []


LINE_OFF_M, WALL_OFF_M = 0.1, 0.12
"""Of lines in the middles of walls from the faces that are seen, and of one that is drawn elsewhere."""


def room_of_lines():
    """The room as lines in the middles of its walls, the east one drawn off; and the number of that."""
    low, east = -LINE_OFF_M, 6.0 + LINE_OFF_M + WALL_OFF_M
    north = 4.0 + LINE_OFF_M
    corners = np.array([[low, low], [east, low], [east, north], [low, north]])
    ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return Floorplan.from_segments(ends, np.full((4, 2), np.nan), name="lines"), 1


def press_east_wall(page, plan, wall):
    page.press_plan(plan.ends[wall].mean(axis=0))
    page.wait_for("document.querySelectorAll('.hand-plan line.chosen').length === 1")
    page.press(".hand-unuse")


def press_what_is_told(page, plan, wall):
    """The button beside the wall in the list of what contradicts what."""
    page.press(".hand-disagreements li button")


@pytest.mark.slow
@pytest.mark.parametrize("way", [press_east_wall, press_what_is_told])
def test_a_wall_of_a_plan_of_lines_that_misleads_is_left_out(browser, tmp_path, monkeypatch, way):
    """Lines became faces half a wall before them; what is pressed is the line, which the given plan has."""
    walk = walk_in_a_room(14)
    scan, (plan, wall), folder = room_scan(walk), room_of_lines(), tmp_path / "out"
    monkeypatch.setattr(RoomFiles, "write_poses", lambda *_: None)
    observations = extract_observations(scan)
    first = planfit.refine(scan, plan, observations=observations)
    thick = first.floorplan
    assert thick is not None
    assert thick.drawn is not None
    faces = np.flatnonzero(np.abs(thick.drawn - plan.ends[wall]).max(axis=(1, 2)) < 1e-6)
    (seen,) = [face for face in faces if thick.normals[face, 0] < 0]
    assert thick.ends[seen, 0, 0] < plan.ends[wall, 0, 0] - 0.05
    ends = tuple((float(x), float(y)) for x, y in thick.drawn_ends[seen])
    item = EvidenceItem("wall", face_idx=int(seen), ends=ends)
    told = Disagreement(item, 0.0, WALL_OFF_M, ())
    save_result(replace(first, evidence=replace(first.evidence, disagreements=(told,))), folder)
    last = [first]

    def solve(corrections):
        last[0] = planfit.refine(scan, plan, observations=observations, corrections=corrections)
        save_result(last[0], folder)

    with served(Session(folder, scan, plan, solve)) as server:
        page = Panel(browser, server, (1200, 900))
        assert position_rms_m(refined_poses(folder), walk) > 0.04
        way(page, plan, wall)
        page.wait_for("document.querySelectorAll('.hand-list li').length === 1")
        (excluded,) = read_corrections(folder / "corrections.toml").wall_ends("exclude_wall")
        np.testing.assert_allclose(np.sort(excluded, axis=0), np.sort(plan.ends[wall], axis=0))
        page.solve()
        assert "refused" not in page.status
        assert "used" in page.find(".hand-list li").text
        assert position_rms_m(refined_poses(folder), walk) < 0.01
        # The plan on the page is as given, and the wall can be taken in again.
        assert len(browser.find_elements(By.CSS_SELECTOR, ".hand-plan svg > line")) == 4
        page.press(".hand-list li button")
        page.wait_for("document.querySelectorAll('.hand-list li').length === 0")
        page.press(".hand-solve")
        end = time.monotonic() + 60
        # What the solve before changed is still told meanwhile.
        while position_rms_m(last[0].plan_from_cams, walk) < 0.04:
            assert time.monotonic() < end, page.status
            time.sleep(0.1)
        server.session.wait()
        assert position_rms_m(refined_poses(folder), walk) > 0.04
        assert browser.get_log("browser") == []
