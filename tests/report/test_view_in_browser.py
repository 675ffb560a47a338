"""The 3D view in a real browser without a network: what is pressed is shown, and stands where it should."""

import io
import time
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from view_speed import make_scene

from driven_browser import driven_browser, needs_browser, set_size
from planfit.geometry import se3
from planfit.report.html.page import make_report, page_of
from planfit.report.html.view_section import view_section
from report.scenes import BLUE, GREEN, RED, room_report, room_scene
from test_report import DEPTH, OFFSET, WIDTH, make_result

pytest.importorskip("selenium.webdriver", reason="no selenium to drive a browser with")
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

pytestmark = needs_browser
OFFSETS = (0.0, 0.0, 0.07, -0.12)
VIEW_HEIGHT = 1.1
"""Of the drawing from above, in heights of what is to be seen."""


@pytest.fixture(scope="module")
def browser():
    with driven_browser() as driver:
        driver.execute_cdp_cmd("Network.enable", {})
        driver.execute_cdp_cmd(
            "Network.emulateNetworkConditions",
            {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0},
        )
        yield driver


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Its page, and the scene that it shows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("planfit.report.scene._FIRST_POINTS", 800)
        patch.setattr("planfit.report.scene._LEVEL_POINTS", 2500)  # five levels in all
        html, scene = room_report(offsets=OFFSETS, max_pictures=6)
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(html, encoding="utf-8")
    return path, scene


@pytest.fixture
def view(browser, report):
    return open_page(browser, *report, (1200, 900))


def open_page(browser, path, scene, size):
    set_size(browser, *size)
    browser.get(path.as_uri())
    return ViewPage(browser, scene)


class ViewPage:
    """The page as a person uses it."""

    def __init__(self, browser, scene):
        self.browser, self.scene = browser, scene
        self.wait_for("document.getElementById('view').dataset.state === 'ready'")
        self.find("canvas")
        self.browser.execute_script("document.getElementById('view').scrollIntoView()")

    def wait_for(self, condition, seconds=30):
        end = time.monotonic() + seconds
        while not self.browser.execute_script(f"return {condition}"):
            assert time.monotonic() < end, f"{condition}: {self.browser.get_log('browser')}"
            time.sleep(0.05)

    def find(self, selector):
        return self.browser.find_element(By.CSS_SELECTOR, selector)

    def press(self, selector):
        self.browser.execute_script("arguments[0].click()", self.find(selector))

    def choose_color(self, words):
        for option in self.browser.find_elements(By.CSS_SELECTOR, ".view-color option"):
            if option.text == words:
                option.click()
                return
        raise AssertionError(f"no colour {words}")

    def pixels(self):
        """What the canvas shows once all is drawn, (h, w, 3)."""
        self.browser.execute_script("document.querySelector('.view-stage').scrollIntoView()")
        self.browser.execute_async_script(
            "const done = arguments[0]; setTimeout(() => requestAnimationFrame(() => "
            "requestAnimationFrame(() => done())), 300)"
        )
        picture = self.find(".view-stage canvas").screenshot_as_png
        return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)

    def from_above(self, with_walls=False):
        """Drawn as a plan; without walls and path, so that points alone have colours."""
        self.press(".view-above")
        for name in () if with_walls else ("walls", "path"):
            self.press(f".view-{name}")

    def metres_of(self, mask):
        """Mean x and y, plan frame, m, of pixels of the drawing from above."""
        v, u = np.nonzero(mask)
        h, w = mask.shape
        at = self.scale(h, w)
        middle = self.scene.bounds.mean(axis=0)
        return middle[0] + (u.mean() + 0.5 - w / 2) * at, middle[1] - (v.mean() + 0.5 - h / 2) * at

    def pixel_of(self, x, y):
        """From the middle of the canvas, where a point of the plan is drawn from above, px."""
        size = self.find(".view-stage canvas").size
        at = self.scale(size["height"], size["width"])
        middle = self.scene.bounds.mean(axis=0)
        return round((x - middle[0]) / at), round((middle[1] - y) / at)

    def scale(self, height, width):
        """Metres of a pixel."""
        across, up, _ = self.scene.bounds[1] - self.scene.bounds[0]
        return VIEW_HEIGHT * max(across * height / width, up) / height

    def press_plan(self, x, y):
        self.browser.execute_script("document.querySelector('.view-stage').scrollIntoView()")
        canvas = self.find(".view-stage canvas")
        ActionChains(self.browser).move_to_element_with_offset(
            canvas, *self.pixel_of(x, y)
        ).click().perform()

    @property
    def card(self):
        card = self.find(".view-card")
        return card.text if card.is_displayed() else ""


def near(pixels, color):
    return np.abs(pixels - color).max(axis=2) < 12


def changed(a, b):
    """Share of the pixels with anything on them that differ."""
    differs = np.abs(a - b).max(axis=2) > 8
    return differs.sum() / max(((a.min(axis=2) < 250) | (b.min(axis=2) < 250)).sum(), 1)


def press_picture(view, alt, x, y):
    """At values of the axes."""
    return view.browser.execute_script(
        "const [alt, x, y] = arguments, image = document.querySelector(`svg[aria-label='${alt}']`);"
        "const c = JSON.parse(image.dataset.clicks), r = image.getBoundingClientRect();"
        "const at = (v, [a, b]) => (v - a) / (b - a);"
        "const u = c.box[0] + at(x, c.x) * (c.box[2] - c.box[0]);"
        "const v = c.box[3] - at(y, c.y) * (c.box[3] - c.box[1]);"
        "image.dispatchEvent(new MouseEvent('click',"
        " {clientX: r.left + u * r.width, clientY: r.top + v * r.height, bubbles: true}));",
        alt, x, y,
    )  # fmt: skip


def test_page_needs_no_network_and_has_no_errors(view):
    assert int(view.find("#view").get_attribute("data-points")) == len(view.scene.points.points_cam)
    asked = view.browser.execute_script(
        "return performance.getEntriesByType('resource').map((e) => e.name)"
    )
    assert [name for name in asked if not name.startswith(("data:", "blob:"))] == []
    assert view.find(".view-note").text == ""
    assert view.browser.get_log("browser") == []


def test_points_stand_in_the_plan_before_and_after(view):
    """Red is the wall x = WIDTH, green y = DEPTH, blue x = 0."""
    view.from_above()
    for side, offset in (("after", 0 * OFFSET), ("before", OFFSET)):
        view.press(f"input[value={side}]")
        pixels = view.pixels()
        assert view.metres_of(near(pixels, RED & np.int64(0xFC)))[0] == pytest.approx(
            WIDTH - OFFSETS[1] + offset[0], abs=0.015
        )
        assert view.metres_of(near(pixels, GREEN & np.int64(0xFC)))[1] == pytest.approx(
            DEPTH - OFFSETS[2], abs=0.015
        )
        assert view.metres_of(near(pixels, BLUE & np.int64(0xFC)))[0] == pytest.approx(
            OFFSETS[3] + offset[0], abs=0.015
        )


def test_wipe_shows_before_on_the_left_and_after_on_the_right(view):
    view.press(".view-walls")
    view.press("input[value=before]")
    before = view.pixels()
    view.press("input[value=after]")
    after = view.pixels()
    assert changed(before, after) > 0.3
    view.press("input[value=wipe]")
    view.browser.execute_script(
        "const wipe = document.querySelector('.view-wipe'); wipe.value = 0.4;"
        "wipe.dispatchEvent(new Event('input'))"
    )
    both = view.pixels()
    middle = slice(60, -40)  # clear of the words above and the handle below
    split = round(0.4 * both.shape[1])
    assert np.array_equal(both[middle, : split - 2], before[middle, : split - 2])
    assert np.array_equal(both[middle, split + 2 :], after[middle, split + 2 :])


def test_each_colour_is_another_and_says_what_it_means(view):
    view.press(".view-walls")
    seen = [view.pixels()]
    for words, legend in (
        ("height", "m"), ("distance to the plan", "on the plan"), ("time", "first frame")
    ):  # fmt: skip
        view.choose_color(words)
        assert legend in view.find(".view-legend").text
        seen.append(view.pixels())
        for other in seen[:-1]:
            assert changed(other, seen[-1]) > 0.2


def test_distance_to_the_plan_is_blue_on_it_and_grey_far_away(view):
    view.from_above()
    view.choose_color("distance to the plan")
    after = view.pixels()
    assert near(after, (0, 115, 179)).sum() > 500  # walls 0 and 1 are where they are drawn
    view.press("input[value=before]")
    before = view.pixels()
    # All is 0.3 m off along x: walls 1 and 3, at the ends of x.
    assert near(before, (0, 115, 179)).sum() < near(after, (0, 115, 179)).sum()
    assert near(before, (214, 94, 0)).sum() > 200


def test_pressing_a_camera_shows_its_image_and_where_it_stands(view):
    view.press(".view-above")
    x, y, z = view.scene.after[7][:3, 3]
    view.press_plan(x, y)
    assert view.card.startswith(("Frame 7", "\u00d7\nFrame 7"))
    assert f"x {x:.2f}, y {y:.2f}, height {z:.2f} m" in view.card
    assert "0.300 m" in view.card
    image = view.find(".view-card img")
    assert image.get_attribute("data-frame") == "7"
    assert view.browser.execute_script("return arguments[0].naturalWidth", image) == 80
    view.press(".view-card button[aria-label='next frame']")
    assert "Frame 8" in view.card
    assert (
        "this is frame 9, the nearest" in view.card or "this is frame 7, the nearest" in view.card
    )
    view.press(".view-card button[aria-label=close]")
    assert view.card == ""


def test_pressing_a_wall_shows_its_offset_and_its_points(view):
    view.from_above(with_walls=True)
    without = view.pixels()
    view.press_plan(0.0, DEPTH / 2)
    assert "Wall No. 4 of the plan" in view.card
    assert "moved by 0.120 m" in view.card
    assert "into the wall" in view.card
    pixels = view.pixels()
    # Points of the wall go from blue towards grey at 12 of 20 cm behind it; all others fade.
    assert changed(without, pixels) > 0.2
    assert near(pixels, RED & np.int64(0xFC)).sum() == 0
    assert (
        pixels[:, : pixels.shape[1] // 2, 2] - pixels[:, : pixels.shape[1] // 2, 0] > 60
    ).sum() > 50


def test_a_page_around_it_is_told_the_point_that_was_pressed(view):
    """As `planfit view` asks for: frame and point, in its camera's axes, in front of what lies behind."""
    view.press(".view-above")
    view.browser.execute_script(
        "const { view } = document.getElementById('view');"
        "view.onPoint = (found) => (window.found = found)"
    )
    points, frames = view.scene.points.points_cam, view.scene.points.frame_idx
    for k in (10, 1000, 3333):
        i = int(frames[k])
        at = se3.transform(view.scene.after[i], points[k][None].astype(float))[0]
        view.press_plan(*at[:2])
        found = view.browser.execute_script("return window.found")
        # The nearest to the eye of what is drawn there: as high as the highest, and under the finger.
        placed = se3.transform(view.scene.after[found["frame"]], np.array([found["point"]]))[0]
        reach_m = 7 * view.scale(
            *[view.find(".view-stage canvas").size[n] for n in ("height", "width")]
        )
        assert np.linalg.norm(placed[:2] - at[:2]) < reach_m + 0.005
        of_frame = frames == found["frame"]
        nearest = np.linalg.norm(points[of_frame] - found["point"], axis=1).min()
        assert nearest < 0.001  # it is a point of that frame, but for its rounding
        drawn = view.browser.execute_script(
            "return document.getElementById('view').view.drawnAt(arguments[0], arguments[1])",
            found["point"], found["frame"],
        )  # fmt: skip
        across, down = view.pixel_of(*placed[:2])
        size = view.find(".view-stage canvas").size
        assert drawn == pytest.approx(
            [across + size["width"] / 2, down + size["height"] / 2], abs=1.5
        )
    view.press_plan(4.0, 2.5)  # the middle of the room: nothing
    assert view.browser.execute_script("return window.found") is None
    assert view.card == ""  # neither a camera nor a wall was chosen


def unfold(view):
    """Open all sections of the page."""
    view.browser.execute_script(
        "document.querySelectorAll('details.section').forEach((section) => (section.open = true))"
    )


def test_frames_and_walls_are_pressed_in_tables_and_plots(view):
    unfold(view)
    view.press("[data-wall='2'] button")
    assert "moved by 0.070 m" in view.card
    view.browser.execute_script("document.querySelector('footer').scrollIntoView()")
    view.press("[data-frame] button")
    assert "Frame " in view.card
    card = view.find(".view-card")
    view.wait_for("document.querySelector('.view-card').classList.contains('is-away')")
    assert card.rect["y"] > 0  # inside the window, though the view is not

    press_picture(view, "Predicted error of each frame", 5.2, 0.0)
    assert "Frame 5" in view.card
    press_picture(view, "Matched points of each keyframe", 3.0, 0.0)
    assert "Frame 3" in view.card
    press_picture(view, "Verified loop closures from above", *view.scene.after[10][:2, 3])
    assert "Frame 10" in view.card
    assert view.browser.get_log("browser") == []


def press_map(view, x, y):
    """The map of walls as built, at a point of the plan, m."""
    view.browser.execute_script(
        "const [x, y] = arguments, svg = document.querySelector('.as-built svg');"
        "svg.scrollIntoView({block: 'center'});"
        "const { left, top } = svg.dataset, matrix = svg.getScreenCTM();"
        "const at = new DOMPoint(x - left, top - y).matrixTransform(matrix);"
        "document.elementFromPoint(at.x, at.y).dispatchEvent("
        "new MouseEvent('click', {clientX: at.x, clientY: at.y, bubbles: true}));",
        x, y,
    )  # fmt: skip


def test_walls_are_pressed_on_the_map_of_walls_as_built(view):
    """A line is as thin as a hair: a finger beside it means it."""
    unfold(view)
    for y in (DEPTH, DEPTH - 0.05):
        press_map(view, 4.0, y)
        assert "Wall No. 3 of the plan" in view.card
        assert "moved by 0.070 m" in view.card
        view.press(".view-close")
    press_map(view, 3.0, 2.0)
    assert "Wall No. 5, which the plan lacks" in view.card
    view.press(".view-close")
    press_map(view, 4.0, 3.0)
    assert view.card == ""
    view.press("[data-wall='-5'] button")
    assert "Wall No. 5" in view.card
    assert view.browser.get_log("browser") == []


def test_walls_in_3d_have_the_verdicts_of_the_tolerance_that_is_chosen(view):
    view.from_above(with_walls=True)
    view.press(".view-path")
    view.press("[data-wall='2'] button")
    before = view.pixels()
    view.browser.execute_script(
        "const input = document.querySelector('.as-built-tolerance'); input.value = '0.1';"
        "input.dispatchEvent(new Event('input'))"
    )
    after = view.pixels()
    # The wall of +7 cm agrees within 10 cm, that of -12 cm does not.
    assert "agrees: off by +0.070 m" in view.card
    status = "return document.getElementById('view').view.scene.walls.map((wall) => wall.status)"
    assert view.browser.execute_script(status) == ["agrees"] * 3 + ["moved", "new"]
    assert np.abs(before - after).max() > 60


def test_keys_turn_toggle_and_step(view):
    canvas = view.find(".view-stage canvas")
    seen = [view.pixels()]
    for key in (Keys.ARROW_LEFT, Keys.ARROW_UP, Keys.SHIFT + Keys.ARROW_RIGHT, "+", "-", "b", "c"):
        canvas.send_keys(key)
        seen.append(view.pixels())
        assert changed(seen[-2], seen[-1]) > 0.1, key
    canvas.send_keys("..")
    assert "Frame 1" in view.card
    canvas.send_keys(",")
    assert "Frame 0" in view.card
    canvas.send_keys(Keys.ESCAPE)
    assert view.card == ""


def test_cut_hides_what_is_higher(view):
    view.press(".view-walls")
    view.press(".view-path")
    whole = view.pixels()
    view.browser.execute_script(
        "const cut = document.querySelector('.view-cut'); cut.value = cut.min;"
        "cut.dispatchEvent(new Event('input'))"
    )
    assert (view.pixels().min(axis=2) < 250).sum() < 0.2 * (whole.min(axis=2) < 250).sum()


def test_phone_turns_and_pinches_and_nothing_is_cut_off(browser, report):
    view = open_page(browser, *report, (390, 844))
    page = browser.execute_script(
        "return [document.documentElement.scrollWidth, document.querySelector('canvas').clientWidth]"
    )
    assert page[0] <= 390
    assert page[1] > 340
    seen = [view.pixels()]
    rim = browser.execute_script(
        "const r = document.querySelector('canvas').getBoundingClientRect(); return [r.left, r.top]"
    )

    def touch(kind, *fingers):
        points = [{"x": rim[0] + x, "y": rim[1] + y, "id": i} for i, (x, y) in enumerate(fingers)]
        browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", (100, 100))
    touch("touchMove", (180, 130))
    touch("touchEnd")
    seen.append(view.pixels())
    touch("touchStart", (100, 100), (160, 160))
    touch("touchMove", (60, 60), (220, 220))
    touch("touchEnd")
    seen.append(view.pixels())
    assert changed(seen[0], seen[1]) > 0.3
    assert changed(seen[1], seen[2]) > 0.3
    view.press("[data-wall='2'] button")
    card = view.find(".view-card").rect
    assert card["x"] >= 0
    assert card["x"] + card["width"] <= 390


def test_plots_of_before_find_frames_where_they_were(view):
    """At a point whose nearest camera is another before than after."""
    before, after = view.scene.before[:, :2, 3], view.scene.after[:, :2, 3]
    points = np.stack(np.meshgrid(np.linspace(2, 6, 9), np.linspace(1.5, 4.5, 9)), axis=-1).reshape(
        -1, 2
    )
    apart = [np.linalg.norm(points[:, None] - side, axis=2) for side in (before, after)]
    nearest = [a.argmin(axis=1) for a in apart]
    margin = np.min([np.diff(np.sort(a, axis=1)[:, :2], axis=1)[:, 0] for a in apart], axis=0)
    k = int(np.where(nearest[0] != nearest[1], margin, -1.0).argmax())
    assert margin[k] > 0.1
    for name, expected in zip(("before", "after"), nearest, strict=True):
        press_picture(view, f"Wall points {name}, from above", *(float(v) for v in points[k]))
        assert f"Frame {expected[k]} " in view.card


def test_without_a_plan_the_scan_alone_is_shown(browser, tmp_path):
    scene, result = room_scene(result=replace(make_result(), alignment=None, floorplan=None))
    path = tmp_path / "report.html"
    path.write_text(make_report("room", None, result, "", scene=scene), encoding="utf-8")
    view = open_page(browser, path, scene, (1200, 900))
    words = [o.text for o in browser.find_elements(By.CSS_SELECTOR, ".view-color option")]
    assert words == ["image", "height", "time"]
    seen = [view.pixels()]
    for step in ("input[value=before]", ".view-above", ".view-path"):
        view.press(step)
        seen.append(view.pixels())
        assert changed(seen[-2], seen[-1]) > 0.02, step
    assert browser.get_log("browser") == []


def test_cameras_a_few_centimetres_apart_are_drawn_as_one(browser, view, tmp_path):
    """A thousand frames 2 cm apart, as of video: every third is a dot, and the path goes over all of them."""
    n_drawn = "return [view.view.renderer.centres.n, view.view.renderer.path.n]"
    assert browser.execute_script(n_drawn) == [12, 22]  # those of the room are all drawn
    scene = make_scene(20_000, 1000)
    path = tmp_path / "report.html"
    path.write_text(page_of("view", [view_section(scene)], scene), encoding="utf-8")
    far = open_page(browser, path, scene, (1200, 900))
    dots, ends = browser.execute_script(n_drawn)
    # 20 rooms of 50 frames, a metre each: 17 dots, and their last and first ones.
    assert 20 * 15 < dots < 20 * 20
    assert ends == 2 * (dots - 1)
    # What is not drawn is chosen as well.
    browser.execute_script("view.view.choose({frame: 501})")
    assert "Frame 501" in far.card
    assert browser.get_log("browser") == []


def test_without_webgl_the_rest_of_the_page_works(browser, report, tmp_path):
    path, _ = report
    page = tmp_path / "report.html"
    blind = "<script>HTMLCanvasElement.prototype.getContext = () => null;</script>"
    page.write_text(path.read_text().replace("<body>", f"<body>{blind}", 1))
    browser.get(page.as_uri())
    section = browser.find_element(By.ID, "view")
    assert section.get_attribute("data-state") == "failed"
    assert "no WebGL 2" in section.find_element(By.CSS_SELECTOR, ".view-note").text
    button = browser.find_element(By.CSS_SELECTOR, "[data-frame] button")
    browser.execute_script("arguments[0].click()", button)
    assert browser.find_element(By.CSS_SELECTOR, ".view-card").is_displayed()
