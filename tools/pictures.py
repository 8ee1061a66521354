"""Take the pictures of the Tester for README and docs: ``python tools/pictures.py [--only NAME ...]``.

For each language, a Tester with a virtual RC8, VE026A and ABH3 is started. Every page of its table ``PAGES`` is opened in
Debian's Chromium, filled as the table in tools/picture_pages.py states, and stored in docs/pictures:

* ``NAME.LANGUAGE.png``: 1360 pixels wide, light. NAME is the path of the page; ``connections`` for ``/``.
* ``arm-dark.LANGUAGE.png``, and ``arm-phone.LANGUAGE.png``, 400 pixels wide with two pixels for each.
* ``jogging.LANGUAGE.webp``: the page Arm while the arm is jogged, in real time.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple
from urllib.parse import urlencode

from PIL import Image, ImageColor
from playwright.sync_api import Error as PageError
from playwright.sync_api import sync_playwright

from orinkit.core.i18n import Language, translate
from orinkit.tester.pages import PAGES
from orinkit.tester.state.simulators import KINDS
from picture_pages import EARLIER_STRINGS, FILLS, NotShownError, Visit, enable_jogging, move_home, press, set_slider

PICTURES: Final = Path(__file__).parents[1] / "docs" / "pictures"
FAILED: Final = Path(__file__).parents[1] / "build" / "picture-failed.png"
LANGUAGES: Final[tuple[Language, ...]] = ("en", "ja")
_WIDTH: Final = 1360
_HEIGHTS: Final = range(760, 2001)
_PAGE: Final = (_WIDTH, _HEIGHTS.start)
_PHONE: Final = (400, 860)
_LARGEST: Final = 150_000  # bytes of a picture; larger ones are reduced to the following number of colours
_COLOURS: Final = 152
_ATTEMPTS: Final = 6
_PATIENCE: Final = 60_000  # ms
_SETTLE: Final = 1_200  # ms
_CHROMIUM: Final = (
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--hide-scrollbars", "--force-color-profile=srgb", "--font-render-hinting=none",
)  # fmt: skip
_STATE_COLOURS: Final = (
    "#ffffff", "#f5f7f9", "#18212b", "#0c1117", "#141b23", "#e0f2f7", "#0e7490", "#16a34a", "#15803d", "#d1eddb", "#4ade80", "#d97706", "#c81e1e", "#f87171", "#b45309", "#fbbf24", "#f2b705", "#3b82f6", "#dc2626",
)  # fmt: skip
_FILM: Final = (1280, 720)  # pixels of the page
_FILM_WIDTH: Final = 900  # pixels of the animation
_FILM_QUALITIES: Final = (72, 66, 60, 54, 48, 42)
_LARGEST_FILM: Final = 264_000  # bytes
_FRAME: Final = 100  # ms
_SCENES: Final = (  # coordinates, button, seconds
    (1, "z-", 1.2), (1, "y+", 1.6), (1, "x-", 1.2), (0, "j1-", 2.2), (0, "j3-", 1.2), (1, "z+", 1.2),
)  # fmt: skip
_POINTER: Final = """
addEventListener('DOMContentLoaded', () => {
  const pointer = document.createElement('div');
  pointer.setAttribute('aria-hidden', 'true');
  pointer.style.cssText = 'position:fixed;left:-50px;top:0;z-index:99999;pointer-events:none;width:26px;height:26px';
  pointer.innerHTML = '<svg viewBox="0 0 26 26"><path d="M3 2v18l5-4.6 3.4 7.6 3.2-1.4-3.4-7.4H18z" fill="#111" ' +
    'stroke="#fff" stroke-width="1.6" stroke-linejoin="round"/></svg>';
  document.body.append(pointer);
  addEventListener('mousemove', event => {
    pointer.style.left = event.clientX - 3 + 'px'; pointer.style.top = event.clientY - 2 + 'px';
  }, true);
});
"""


class Shot(NamedTuple):
    """A picture of a page.

    Attributes:
        name: Name of the file without language.
        path: Path of the page.
        dark: True for dark mode.
        phone: True for the width of a phone.
    """

    name: str
    path: str
    dark: bool = False
    phone: bool = False


def name_of(path: str) -> str:
    """Return the name of the picture of a page."""
    return path.strip("/").replace("/", "-") or "connections"


def shots() -> list[Shot]:
    """Return all pictures in the order in which they are taken: the rows of ``FILLS``, then the other pages."""
    known = [each.path for each in PAGES]
    paths = [*(path for path in FILLS if path in known), *(path for path in known if path not in FILLS)]
    found = [Shot(name_of(path), path) for path in paths]
    place = paths.index("/arm") + 1
    return [*found[:place], Shot("arm-dark", "/arm", dark=True), Shot("arm-phone", "/arm", phone=True), *found[place:]]


def kind_of(path: str) -> str:
    """Return the key of the virtual controller that a page shows."""
    return next((key for key in KINDS if key in path), "rc8")


# --- the Tester and its pages -----------------------------------------------------------------------------------------


@contextmanager
def tester(language: Language, folder: Path) -> Iterator[str]:
    """Run a Tester with all virtual controllers; yield its address."""
    (folder / "orinkit").mkdir()
    (folder / "orinkit" / "connection-strings.json").write_text(json.dumps(EARLIER_STRINGS), "utf-8")
    virtual = [word for key in KINDS for word in ("--virtual", key)]
    process = subprocess.Popen(
        [sys.executable, "-m", "orinkit", "tester", "--http", "127.0.0.1:0", "--no-browser", *virtual],
        stdout=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "XDG_CONFIG_HOME": str(folder), "ORINKIT_LANG": language},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line.startswith("ready "):
            sys.exit(f"orinkit tester did not start: {line}")
        yield line.split()[1]
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(60)


class Studio:
    """One user of a Tester, whose pages are taken.

    Args:
        browser: The browser.
        url: Address of the Tester.
        language: Language of the pages.
        folder: Directory for files.

    Attributes:
        failed: The names of the pictures that could not be taken.
    """

    def __init__(self, browser: Any, url: str, language: Language, folder: Path) -> None:
        self.language = language
        self.failed: list[str] = []
        self._url, self._folder = url, folder
        self._contexts = {
            size: browser.new_context(
                locale="ja-JP" if language == "ja" else "en-US", device_scale_factor=2 if size == _PHONE else 1,
                viewport={"width": size[0], "height": size[1]}, reduced_motion="reduce",
            )
            for size in (_PAGE, _PHONE, _FILM)
        }  # fmt: skip
        self._contexts[_PAGE].request.get(url)
        for context in self._contexts.values():
            context.set_default_timeout(_PATIENCE)
            context.add_cookies(self._contexts[_PAGE].cookies())  # one user, because only one holds the controls

    @contextmanager
    def page(self, path: str, *, dark: bool = False, size: tuple[int, int] = _PAGE) -> Iterator[Any]:
        """Open a page with the controller that it shows; ``size`` is that of the window, in pixels."""
        page = self._contexts[size].new_page()
        try:
            connection = translate(self.language, KINDS[kind_of(path)].label)
            query = urlencode({"lang": self.language, "dark": int(dark), "connection": connection})
            page.goto(f"{self._url}{path}?{query}")
            page.locator(".ok-main").wait_for()
            page.evaluate("document.fonts.ready")
            yield page
        finally:
            page.close()

    def take(self, shot: Shot) -> None:
        """Take a picture; try again if the page does not show what it should."""
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                with self.page(shot.path, dark=shot.dark, size=_PHONE if shot.phone else _PAGE) as page:
                    self._try(page, shot, attempt)
            except (NotShownError, PageError) as error:  # the page is loaded again if it was not heard
                print(f"{shot.name}.{self.language}: attempt {attempt}: {error}".splitlines()[0], flush=True)
            else:
                return
        self.failed.append(f"{shot.name}.{self.language}")

    def _try(self, page: Any, shot: Shot, attempt: int) -> None:
        try:
            self._fill_and_take(page, shot, attempt)
        except PageError:
            FAILED.parent.mkdir(exist_ok=True)
            page.screenshot(path=FAILED)
            raise

    def _fill_and_take(self, page: Any, shot: Shot, attempt: int) -> None:
        page.wait_for_timeout(_SETTLE)
        self._fit(page, shot)
        fill = FILLS.get(shot.path)
        visit = Visit(page, self.language, attempt, self.page, self._folder)
        if fill is None:
            self._store(page, shot)
            return
        with fill(visit):
            self._store(page, shot)

    def _fit(self, page: Any, shot: Shot) -> None:
        """Make the window as high as the page."""
        page.evaluate("window.scrollTo(0, 0)")
        for _ in range(0 if shot.phone else 3):  # some elements are higher in a higher window
            wanted = int(page.evaluate("document.querySelector('.ok-main').getBoundingClientRect().bottom"))
            height = min(max(wanted, _HEIGHTS.start), _HEIGHTS.stop - 1)
            if height == page.viewport_size["height"]:
                return
            page.set_viewport_size({"width": _WIDTH, "height": height})
            page.wait_for_timeout(_SETTLE)

    def _store(self, page: Any, shot: Shot) -> None:
        self._fit(page, shot)
        path = PICTURES / f"{shot.name}.{self.language}.png"
        size = store(page.screenshot(), path)
        print(f"{path.name}: {size / 1000:.0f} kB", flush=True)

    def film(self) -> None:
        """Record the page Arm while the arm is jogged."""
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                frames = self._record(attempt)
            except (NotShownError, PageError) as error:
                print(f"jogging.{self.language}: attempt {attempt}: {error}".splitlines()[0], flush=True)
                continue
            path = PICTURES / f"jogging.{self.language}.webp"
            store_film(frames, path)
            print(f"{path.name}: {len(frames)} frames, {path.stat().st_size / 1000:.0f} kB", flush=True)
            return
        self.failed.append(f"jogging.{self.language}")

    def _record(self, attempt: int) -> list[Frame]:
        with self.page("/arm", size=_FILM) as page:  # if a window is resized, the frames keep its first size
            page.add_init_script(_POINTER)
            page.reload()
            move_home(Visit(page, self.language, attempt, self.page, self._folder))
            page.bring_to_front()
            frames = record(page)
            if page.locator(".ok-jog-notice").count():
                raise NotShownError(page.get_by_test_id("jog-message").inner_text())
            return frames

    def close(self) -> None:
        """Close the pages."""
        for context in self._contexts.values():
            context.close()


# --- files ------------------------------------------------------------------------------------------------------------


def store(png: bytes, path: Path) -> int:
    """Write a picture as PNG of a moderate size; return its size in bytes."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.save(path, optimize=True)
    if path.stat().st_size > _LARGEST:
        picture.quantize(palette=_palette(picture), dither=Image.Dither.NONE).save(path, optimize=True)
    return path.stat().st_size


def _palette(picture: Image.Image) -> Image.Image:
    """Return a palette, which contains the colours of states although they fill small areas."""
    colours = [ImageColor.getrgb(name) for name in _STATE_COLOURS]
    frequent = picture.quantize(_COLOURS - len(colours)).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette(frequent[: 3 * (_COLOURS - len(colours))] + [part for colour in colours for part in colour])
    return palette


class Frame(NamedTuple):
    """A recorded frame: the time in s, and the picture as JPEG."""

    time: float
    data: bytes


def record(page: Any) -> list[Frame]:
    """Jog the arm, and return what the browser has displayed meanwhile."""
    enable_jogging(page)
    page.get_by_test_id("jog-frame").get_by_role("button").nth(1).click()
    page.get_by_test_id("jog-z-").wait_for()
    set_slider(page, "jog-speed", 70)
    page.wait_for_timeout(_SETTLE)
    frames: list[Frame] = []
    session = page.context.new_cdp_session(page)

    def take(event: dict[str, Any]) -> None:
        frames.append(Frame(event["metadata"]["timestamp"], base64.b64decode(event["data"])))
        session.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]})

    session.on("Page.screencastFrame", take)
    session.send("Page.startScreencast", {"format": "jpeg", "quality": 92, "everyNthFrame": 1})
    for frame, button, seconds in _SCENES:
        choice = page.get_by_test_id("jog-frame").get_by_role("button").nth(frame)
        if choice.get_attribute("aria-pressed") != "true":
            choice.click()
            page.get_by_test_id(f"jog-{button}").wait_for()
        press(page, button)
        page.wait_for_timeout(1000 * seconds)
        page.mouse.up()
        page.wait_for_timeout(350)
    session.send("Page.stopScreencast")
    page.get_by_test_id("jog-enable").click()
    return frames


def store_film(frames: list[Frame], path: Path) -> None:
    """Write frames as an animation in real time, which is repeated, with the best quality that is not too large."""
    start, end = frames[0].time, frames[-1].time
    times = [start + number * _FRAME / 1000 for number in range(int((end - start) * 1000 / _FRAME) + 1)]
    pictures: list[Image.Image] = []
    index, size = 0, (_FILM_WIDTH, _FILM_WIDTH * _FILM[1] // _FILM[0])
    for at in times:
        while index + 1 < len(frames) and frames[index + 1].time <= at:
            index += 1
        pictures.append(
            Image.open(io.BytesIO(frames[index].data)).convert("RGB").resize(size, Image.Resampling.LANCZOS)
        )
    durations = [_FRAME] * (len(pictures) - 1) + [1200]
    for quality in _FILM_QUALITIES:
        pictures[0].save(
            path, save_all=True, append_images=pictures[1:], duration=durations, loop=0, quality=quality, method=4,
            minimize_size=False, kmax=len(pictures),
        )  # fmt: skip
        if path.stat().st_size <= _LARGEST_FILM:
            return


def main() -> None:
    """Take the pictures."""
    names = [each.name for each in shots()] + ["jogging"]
    parser = argparse.ArgumentParser(description="Take the pictures of the Tester for README and docs.")
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--language", choices=LANGUAGES, help="only this language")
    given = parser.parse_args()
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("Chromium is missing. Debian, Ubuntu: apt-get install chromium fonts-noto-cjk")
    PICTURES.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    failed: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(_CHROMIUM))
        for language in [given.language] if given.language else LANGUAGES:
            with TemporaryDirectory(prefix="orinkit-pictures-") as folder, tester(language, Path(folder)) as url:
                studio = Studio(browser, url, language, Path(folder))
                for shot in shots():
                    if not given.only or shot.name in given.only:
                        studio.take(shot)
                if not given.only or "jogging" in given.only:
                    studio.film()
                failed += studio.failed
                studio.close()
        browser.close()
    print(f"{PICTURES}: {time.monotonic() - started:.0f} s")
    if failed:
        sys.exit(f"not taken: {', '.join(failed)}. Try again while the machine is idle.")


if __name__ == "__main__":
    main()
