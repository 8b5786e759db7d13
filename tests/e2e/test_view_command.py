"""``oed view``: what it shows, first without a browser, then in one."""

import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import viser
from browser import chromium
from command_line import oed
from conftest import STUDY, write_study

import oed as what_to_measure
from estimators import FrfEstimate, best_additions, write_frf
from oed.study.pipeline import design_study, fit_study
from oed.study.settings.study_file import load_study
from reports import text
from reports.commands import view as command
from reports.viewer.view import View
from reports.viewer.viewer import Viewer, serving
from robotmodels import frequency_response, load_robot

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:websockets")


@pytest.fixture(scope="module")
def study(small_study):
    return load_study(small_study[0].parents[1] / "study.yaml")


@pytest.fixture(scope="module")
def planned(study):
    return View.of_study(design_study(study))


@pytest.fixture(scope="module")
def fitted(study):
    return View.of_study(fit_study(study))


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture
def viewer(planned):
    with serving(free_port()) as server:
        yield Viewer(planned, server)


def test_a_visit_more_gains_what_the_score_of_the_plan_says(planned):
    plan = planned.study.plan
    score = what_to_measure.score(
        plan.information, plan.used, plan.exact.repetitions[plan.used], additions=3
    )
    for one in score.additions:
        gain = planned.gain(planned.candidates[one.candidate])
        # The score's is that of det^(1/p) of the information, of variances thus.
        assert gain.factor**2 == pytest.approx(one.gain, rel=1e-6)
        assert gain.after < gain.before


def test_a_visit_more_of_measured_data_has_their_mean_noise(tmp_path):
    robot = load_robot(str(write_study(tmp_path).parent / "robot.yaml"))
    positions = np.array([[-1.6, 1.0], [-0.8, -1.2], [-2.0, 0.3]])
    omega = 2 * np.pi * np.geomspace(3, 60, 12)
    response = frequency_response(robot, positions, omega)
    errors = np.random.default_rng(2).normal(size=(2, *response.shape))
    data = FrfEstimate(
        positions=positions,
        omega=omega,
        response=response + 20 * (errors[0] + 1j * errors[1]) / np.sqrt(2),
        covariance=np.full(response.shape, 400.0),
        repetitions=np.ones(3, dtype=int),
    )
    write_frf(tmp_path / "frf.h5", data)
    (tmp_path / "measured.yaml").write_text(MEASURED)
    view = View.of_study(fit_study(load_study(tmp_path / "measured.yaml")))
    plan = view.study.plan
    total = plan.information.matrices.sum(axis=0)
    alone = best_additions(total, plan.information.matrices, plan.information.names)
    for i in range(3):
        gain = view.gain(plan.information.positions[i])
        assert gain.factor == pytest.approx(alone.gain[i], rel=1e-6)


BAND = (90, 130, 190)
MEASURED = """\
schema: study/1
robot: robot.yaml
data: {frf: frf.h5}
fit: {residuals: [nls], decades: 0.1, starts: 1}
output: measured
"""


def test_frf_and_band_are_those_of_the_model(planned, fitted):
    position, values = planned.candidates[3], fitted.robot.parameters.values
    magnitude, lower, upper = fitted.frf(position, values, 1, 0)
    exact = frequency_response(fitted.robot, position[None], fitted.omega, values)[0, :, 1, 0]
    assert magnitude == pytest.approx(np.abs(exact), rel=1e-9)
    assert (lower < magnitude).all()
    assert (magnitude < upper).all()
    softer = fitted.frf(position, 0.5 * values, 1, 0)[0]
    assert not np.allclose(softer, magnitude, rtol=0.1)
    assert np.isnan(View.of_robot(fitted.robot).frf(position, values, 1, 0)[1:]).all()


def test_a_mode_shape_moves_what_moves_most_by_its_amplitude(planned):
    pose = planned.pose(planned.candidates[3], planned.robot.parameters.values)
    rest = pose.placements()
    for mode in range(len(pose.frequencies)):
        moved = pose.in_mode(mode, 1e-5, np.pi / 2)
        origins = np.linalg.norm(moved[:, :3, 3] - rest[:, :3, 3], axis=1)
        assert origins.max() < 1.001e-5  # the tool may be what moves most
    assert pose.in_mode(0, 0.1, 0.0) == pytest.approx(rest)


def test_candidates_are_coloured_by_weight(planned):
    weights, colours = planned.study.plan.design.weights, planned.colours("weight")
    least = int(np.argmin(np.where(weights > 0, weights, np.inf)))
    best, without = int(np.argmax(weights)), weights <= 0
    assert colours[best].sum() > colours[least].sum()  # viridis rises in brightness
    assert without.any()
    assert len(np.unique(colours[without], axis=0)) == 1
    assert np.ptp(colours[without][0].astype(int)) < 15  # grey
    assert not np.array_equal(colours, planned.colours("sensitivity"))


def test_controls_change_what_is_shown(viewer, planned):
    controls = viewer.controls
    viewer.step(0.0)
    assert "One more visit here" in controls.words.content
    assert controls.position == pytest.approx(planned.study.plan.positions[0], abs=1e-4)
    before = np.array(controls._plot.data[3])
    controls._factors[0].value = -0.5
    viewer.step(0.1)
    assert not np.allclose(controls._plot.data[3], before, rtol=0.05)
    assert controls.values[0] == pytest.approx(planned.robot.parameters.values[0] / 10**0.5)
    controls._mode.value = controls._modes[1]
    viewer.step(0.2)
    first = np.array(viewer._body._frames[-1].position)
    viewer.step(0.7)
    assert np.linalg.norm(viewer._body._frames[-1].position - first) > 1e-3


def test_the_tool_is_dragged_to_a_position_and_back_from_out_of_reach(viewer, planned):
    viewer.step(0.0)
    target = np.array(viewer._tool.position)
    start = viewer.controls.position
    target = planned.tool_points(start[None] + 0.05)[0]
    viewer._drag(SimpleNamespace(target=SimpleNamespace(position=target)))
    viewer.step(0.1)
    assert planned.tool_points(viewer.controls.position[None])[0] == pytest.approx(target, abs=1e-3)
    reached = viewer.controls.position
    viewer._drag(SimpleNamespace(target=SimpleNamespace(position=np.array([9.0, 0, 0]))))
    viewer.step(0.2)
    assert viewer.controls.position == pytest.approx(reached)
    assert viewer._tool.position == pytest.approx(target, abs=1e-3)


def test_springs_too_soft_for_the_arm_are_told(viewer):
    viewer.controls._factors[0].value = viewer.controls._factors[1].value = -1.0
    hardly = viewer._view.robot.parameters.values * 1e-3
    viewer._update(viewer.controls.position, hardly)
    assert "stiff" in viewer.controls.words.content or "spring" in viewer.controls.words.content


def test_twenty_thousand_candidates_are_shown(planned):
    plan = planned.study.plan
    many = np.tile(plan.information.positions, (20_000 // len(plan.information.positions), 1))
    spread = many + np.random.default_rng(1).uniform(-0.01, 0.01, many.shape)
    low, high = planned.robot.position_limits.T
    times = len(many) // len(plan.information.positions)
    info = replace(
        plan.information,
        positions=np.clip(spread, low, high),
        matrices=np.tile(plan.information.matrices, (times, 1, 1)),
    )
    design = replace(
        plan.design,
        weights=np.tile(plan.design.weights, times),
        sensitivity=np.tile(plan.design.sensitivity, times),
    )
    study = replace(planned.study, plan=replace(plan, information=info, design=design))
    with serving(free_port()) as server:
        viewer = Viewer(View(planned.robot, planned.omega, None, study), server)
        viewer.step(0.0)
        names = ("/candidates/with weight", "/candidates/without weight")
        clouds = [server.scene.get_handle_by_name(name) for name in names]
        assert sum(len(cloud.points) for cloud in clouds) == 20_000


def test_without_the_extra_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    code, out, err = oed("view", "ur10")
    assert (code, out) == (2, "")
    assert err.startswith("error: view: the library viser is needed; pip install")
    assert err.count("\n") == 1


@pytest.fixture
def running(study, tmp_path):
    path = Path(study.output).parents[1] / "study.yaml"
    line = [sys.executable, "-m", "reports.cli", "view", str(path), "--port", str(free_port())]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as one:
        yield one, one.stdout.readline().split()[0]
        if one.poll() is None:
            one.kill()


def test_the_page_of_a_study_is_alive_in_a_browser(running):
    process, address = running
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1200, "height": 900})
        requests, errors = [], []
        page.on("request", lambda one: requests.append(one.url))
        page.on("pageerror", lambda one: errors.append(str(one)))
        page.goto(address)
        page.get_by_text("One more visit here").wait_for(timeout=60_000)
        assert page.locator("canvas").count() >= 1
        before = page.get_by_text("One more visit here").inner_text()
        page.get_by_role("slider").first.press("ArrowRight")  # the next visit
        page.wait_for_function(
            "before => !document.body.innerText.includes(before)", arg=before, timeout=30_000
        )
        assert errors == []
        assert [url for url in requests if not url.startswith((address, "data:", "blob:"))] == []
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=20) == 130  # as of every command
    assert "Traceback" not in process.stderr.read()


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """A viewer served here, and its page: what a test moves can be compared with what is drawn."""
    above = STUDY.replace("joint: [-2.5, -0.5]", "joint: [-2.5, 0.6]").replace(
        "candidates:", "candidates:\n  floor: 0.0"
    )
    path = write_study(tmp_path_factory.mktemp("floor"), above)
    view = View.of_study(design_study(load_study(path)))
    wide = replace(view.uncertainty, covariance=900 * view.uncertainty.covariance)
    view = replace(view, uncertainty=wide)  # so that its band is a surface
    with serving(free_port()) as server, chromium() as browser:
        viewer = Viewer(view, server)
        viewer.step(0.0)
        page = browser.new_page(viewport={"width": 1200, "height": 900})
        page.goto(f"http://127.0.0.1:{server.get_port()}")
        page.get_by_text("One more visit here").wait_for(timeout=60_000)
        until(viewer, page, lambda: server.get_clients())
        page.locator(".uplot").wait_for(timeout=30_000)
        yield viewer, page, next(iter(server.get_clients().values()))


def until(viewer, page, holds):
    """Step until something holds, up to half a minute."""
    end = time.monotonic() + 30
    while time.monotonic() < end:
        viewer.step(0.0)
        if holds():
            return
        page.wait_for_timeout(50)
    raise AssertionError("nothing came of it in 30 s")


def on_page(page, camera, point):
    """Return the pixel at which a point (3,) [m] is seen."""
    turned = viser.transforms.SO3(camera.wxyz).as_matrix()
    x, y, z = turned.T @ (point - camera.position)
    box = page.locator("canvas").first.bounding_box()
    half = np.tan(camera.fov / 2) * z
    across = x / (half * box["width"] / box["height"])
    return box["width"] * (1 + across) / 2, box["height"] * (1 + y / half) / 2


def frf_picture(page):
    """Return the pixels of the FRF's plot, (height, width, 4)."""
    plot = page.locator(".uplot canvas").first
    numbers = plot.evaluate(
        "one => [one.height, one.width, ...one.getContext('2d')"
        ".getImageData(0, 0, one.width, one.height).data]"
    )
    return np.array(numbers[2:]).reshape(*numbers[:2], 4)


def test_a_click_on_a_candidate_says_what_it_is(opened):
    viewer, page, client = opened
    weights = viewer._view.study.plan.design.weights
    points = viewer._view.tool_points(viewer._view.candidates)
    for number in np.argsort(-weights)[:2]:
        page.mouse.click(*on_page(page, client.camera, points[number]))
        until(viewer, page, lambda n=number: viewer._view.candidate(viewer.controls.position) == n)
        page.get_by_text(f"Candidate {number + 1} of {len(weights)}").wait_for(timeout=20_000)
        words = page.locator("body").inner_text()
        assert f"weight {text.percent(weights[number])}" in words
        assert "One more visit here: standard deviations fall by" in words


def test_a_click_on_a_rejected_position_says_why(opened):
    viewer, page, client = opened
    page.get_by_text("rejected positions").click()
    until(viewer, page, lambda: viewer._candidates._rejected is not None)
    position = viewer._view.rejected[0]
    page.mouse.click(*on_page(page, client.camera, viewer._view.tool_points(position[None])[0]))
    until(viewer, page, lambda: "Rejected" in viewer.controls.words.content)
    page.get_by_text("Rejected").first.wait_for(timeout=20_000)


def test_the_tool_is_dragged_with_the_mouse_and_the_frf_follows(opened):
    viewer, page, client = opened
    position = viewer._view.study.plan.positions[0]
    viewer.controls.position = position
    until(viewer, page, lambda: viewer.controls.position == pytest.approx(position, abs=1e-4))
    page.wait_for_timeout(500)
    up = np.array([0.0, 0.0, 1.0])
    before, (tool,) = frf_picture(page), viewer._view.tool_points(position[None])
    start = on_page(page, client.camera, tool + 0.2 * up)
    end = on_page(page, client.camera, tool + 0.1 * up)
    page.mouse.move(*start)
    page.mouse.down()
    for share in (0.25, 0.5, 0.75, 1.0):
        page.mouse.move(*(np.add(start, share * np.subtract(end, start))))
        page.wait_for_timeout(50)
    page.mouse.up()
    until(viewer, page, lambda: viewer.controls.position != pytest.approx(position, abs=1e-3))
    (moved,) = viewer._view.tool_points(viewer.controls.position[None])
    assert moved[2] < tool[2] - 0.03
    until(viewer, page, lambda: not np.array_equal(frf_picture(page), before))


def test_the_band_of_the_frf_is_drawn(opened):
    viewer, page, _ = opened
    magnitude, lower, upper = viewer._view.frf(
        viewer.controls.position, viewer.controls.values, 0, 0
    )
    assert (upper > lower).all()
    until(viewer, page, lambda: shaded(page) > 400)
    viewer.controls.show_frf(np.array([magnitude, *np.full((2, len(magnitude)), np.nan)]))
    until(viewer, page, lambda: shaded(page) < 100)


def shaded(page):
    """Return the number of pixels in the colour of the band."""
    near = np.abs(frf_picture(page)[..., :3] - np.array(BAND)).max(axis=2) < 30
    return int(near.sum())


def test_a_robot_without_a_study_is_shown():
    robot = load_robot("manutec_r3")
    with serving(free_port()) as server:
        viewer = Viewer(View.of_robot(robot), server)
        viewer.step(time.monotonic())
        assert viewer.controls.colours is None
        assert "Feasible" in viewer.controls.words.content
