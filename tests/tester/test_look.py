"""The look of every page: contrast, width of a phone, and visible keyboard focus."""

from __future__ import annotations

import pytest

from orinkit.tester.pages import PAGES
from support.browser import needs_browser

pytestmark = [needs_browser, pytest.mark.soak]

PATHS = [page.path for page in PAGES]
SETTLE = 1_500  # ms
MOST_STOPS = 80

# The texts whose contrast is lower than WCAG 2.2, criterion 1.4.3, level AA; inactive elements are exempt.
LOW_CONTRAST = """() => {
  const parse = text => { const n = text.match(/[\\d.]+/g).map(Number); return [n[0], n[1], n[2], n[3] ?? 1]; };
  const over = (top, below) => [0, 1, 2].map(i => top[i] * top[3] + below[i] * (1 - top[3])).concat(1);
  const luminance = colour => {
    const [r, g, b] = colour.map(v => v / 255).map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ancestors = element => { const all = []; for (let e = element; e; e = e.parentElement) all.push(e); return all; };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement, text = walker.currentNode.textContent.trim();
    if (!text || !element.checkVisibility({visibilityProperty: true}) || element.matches('script, style, .q-icon')) continue;
    if (element.closest('[disabled], .disabled, [aria-disabled=true], .q-field--disabled')) continue;
    const all = ancestors(element), styles = all.map(each => getComputedStyle(each));
    if (styles.some(each => each.backgroundImage !== 'none')) continue;
    const background = styles.map(each => parse(each.backgroundColor)).reverse().reduce((b, t) => over(t, b), [255, 255, 255, 1]);
    const opacity = styles.reduce((product, each) => product * each.opacity, 1), ink = parse(styles[0].color);
    const [low, high] = [luminance(background), luminance(over([ink[0], ink[1], ink[2], ink[3] * opacity], background))].sort((a, b) => a - b);
    const size = parseFloat(styles[0].fontSize), large = size >= 24 || size >= 18.66 && styles[0].fontWeight >= 700;
    const ratio = (high + 0.05) / (low + 0.05);
    if (ratio < (large ? 3 : 4.5)) found.push(`${text.slice(0, 40)}: ${ratio.toFixed(2)}`);
  }
  return found;
}"""

FOCUSED = """() => {
  const element = document.activeElement;
  if (!element || element === document.body) return null;
  const style = getComputedStyle(element), box = element.getBoundingClientRect();
  const outlined = style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) > 0;
  const text = element.ariaLabel || element.innerText || element.className;
  return {
    key: [element.tagName, text, box.left, box.top + scrollY].join(),
    visible: outlined || style.boxShadow !== 'none' || !!element.closest('.q-field--focused, .cm-focused'),
    text: `${element.tagName} ${text}`.slice(0, 60),
  };
}"""


def show(page, bench, path, *, language="en", dark=False):
    page.goto(f"{bench.tester.url}{path}?lang={language}&dark={int(dark)}")
    page.locator(".ok-page-title").wait_for()
    page.wait_for_timeout(SETTLE)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_the_contrast_of_all_texts_is_sufficient(page, bench, dark):
    for path in PATHS:
        show(page, bench, path, dark=dark)
        assert not page.evaluate(LOW_CONTRAST), path


@pytest.mark.parametrize("language", ["en", "ja"])
def test_no_page_is_wider_than_a_phone(page, bench, language):
    page.set_viewport_size({"width": 390, "height": 844})
    for path in PATHS:
        show(page, bench, path, language=language)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, path


def test_the_keyboard_focus_is_visible_at_every_stop(page, bench):
    for path in PATHS:
        show(page, bench, path)
        stops = {}
        for _ in range(MOST_STOPS):
            page.keyboard.press("Tab")
            stop = page.evaluate(FOCUSED)
            if stop is None or stop["key"] in stops:
                break
            stops[stop["key"]] = stop
        assert len(stops) > len(PATHS), path  # the navigation, and the elements of the page
        assert not [stop["text"] for stop in stops.values() if not stop["visible"]], path
