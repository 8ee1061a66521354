"""When the drawing of the arm draws a frame: at which times of a clock that the test sets."""

from __future__ import annotations

from typing import Any

from orinkit.arms import load_model
from support.browser import needs_browser

pytestmark = needs_browser

ZERO = [0.0, 0.0, 90.0, 0.0, 0.0, 0.0]
MOVED = [45.0, 0.0, 90.0, 0.0, 0.0, 0.0]

# A drawing with the clock of the test; ``wanted`` is true if it would have requested the next frame from the browser.
WATCHED = """async ([model, software]) => {
  const [{ Drawing }, { THREE }] = await Promise.all([import("orinkit-arm"), import("nicegui-scene")]);
  class Watched extends Drawing {
    clock = 0;
    draws = [];
    wanted = false;
    now() { return this.clock; }
    schedule() { this.wanted = true; }
    draw(rough) { this.draws.push(this.clock); super.draw(rough); }
    async step(clock) {
      const { gl } = this;
      while (this.fence && gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED) {
        await new Promise((resolve) => setTimeout(resolve, 5));
      }
      this.clock = clock;
      if (!this.wanted) return;
      this.wanted = false;
      this.frame();
    }
    async steps(...clocks) {
      this.draws = [];
      for (const clock of clocks) await this.step(clock);
      return this.draws;
    }
    async settle(clock) {
      while (this.wanted) await this.step(clock += 100);
      return clock;
    }
  }
  const drawing = window.okDrawing = new Watched(THREE, document.createElement("canvas"), false, () => {});
  Object.assign(drawing, { software, simple: software });
  drawing.size(64, 64, 1);
  drawing.build(model, "iso");
}"""


def drawing(page: Any, url: str, *, software: bool) -> None:
    """Create ``okDrawing`` in the page."""
    model = load_model("VS-050")
    page.goto(f"{url}/arm")
    page.locator('[data-testid="scene"][data-ready]').wait_for()
    page.evaluate(WATCHED, [{"kind": model.kind, "origins": model.origins, "joints": ZERO}, software])


def test_drawing_without_a_graphics_processor_pauses_for_twice_the_time_of_a_frame(page, bench):
    drawing(page, bench.tester.url, software=True)
    draws = page.evaluate(
        "joints => (okDrawing.joints(joints), okDrawing.steps(1000, 1030, 1089, 1090, 1100, 1119, 1120, 1140))", MOVED
    )
    assert draws == [1000, 1090, 1120]  # the frames were complete after 30 and 10 ms


def test_a_graphics_processor_draws_every_frame_of_a_motion(page, bench):
    drawing(page, bench.tester.url, software=False)
    times = [1000, 1016, 1033, 1050, 1066]
    assert (
        page.evaluate("([joints, times]) => (okDrawing.joints(joints), okDrawing.steps(...times))", [MOVED, times])
        == times
    )


def test_slow_frames_pause_and_become_simple_also_with_a_graphics_processor(page, bench):
    drawing(page, bench.tester.url, software=False)
    draws = page.evaluate("joints => (okDrawing.joints(joints), okDrawing.steps(1000, 1060, 1179, 1180))", MOVED)
    assert draws == [1000, 1180]
    assert not page.evaluate("okDrawing.simple")
    page.evaluate(
        """async () => {
          for (let clock = 1300, angle = 0; clock < 20000; clock += 100) {
            okDrawing.joints([angle++ % 90, 0, 90, 0, 0, 0]);
            await okDrawing.step(clock);
          }
        }"""
    )
    assert page.evaluate("okDrawing.simple")


def test_an_arm_at_standstill_is_drawn_in_full_once_and_then_not_at_all(page, bench):
    drawing(page, bench.tester.url, software=True)
    clock = page.evaluate("okDrawing.settle(1000)")
    assert not page.evaluate("okDrawing.rough")
    draws = page.evaluate(
        "([joints, clock]) => (okDrawing.joints(joints), okDrawing.steps(clock + 5000, clock + 10000))", [ZERO, clock]
    )
    assert draws == []
    draws = page.evaluate(
        """([joints, clock]) => {
          okDrawing.clock = clock + 15000;
          okDrawing.joints(joints);
          return okDrawing.steps(clock + 15016, clock + 20000, clock + 25000);
        }""",
        [MOVED, clock],
    )
    assert draws == [clock + 15016, clock + 20000]  # first simple, then in full
