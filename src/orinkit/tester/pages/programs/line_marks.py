"""Marks on lines of the editor: :func:`mark_lines`.

The property ``decorations`` of ``ui.codemirror`` is not used: each update of a property also sends the text that the
server knows, and would remove what the user is typing at that moment.
"""

from __future__ import annotations

import json

from nicegui import ui

_SCRIPT = """(async () => {
  const CM = await import('nicegui-codemirror');
  const editor = getElement(%d)?.editor;
  if (!editor) return;
  if (!editor.okMarks) {
    const effect = CM.StateEffect.define();
    const field = CM.StateField.define({
      create: () => CM.Decoration.none,
      update: (marks, change) => change.effects.reduce(
        (set, each) => each.is(effect) ? CM.Decoration.set(each.value, true) : set, marks.map(change.changes)),
      provide: each => CM.EditorView.decorations.from(each),
    });
    editor.okMarks = effect;
    editor.dispatch({effects: CM.StateEffect.appendConfig.of(field)});
  }
  const lines = %s.filter(([line]) => line >= 1 && line <= editor.state.doc.lines);
  editor.dispatch({effects: editor.okMarks.of(lines.map(
    ([line, name, title]) => CM.Decoration.line({class: name, attributes: title ? {title} : {}})
      .range(editor.state.doc.line(line).from)))});
})()"""


def mark_lines(editor: ui.codemirror, marks: list[tuple[int, str, str]]) -> None:
    """Mark lines of an editor, instead of those that are marked.

    Args:
        editor: The editor.
        marks: Line, counted from 1; CSS class; text that is displayed beside the mouse pointer, or ``""``.
    """
    editor.client.run_javascript(_SCRIPT % (editor.id, json.dumps(marks)))
