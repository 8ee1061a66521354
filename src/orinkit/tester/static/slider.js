// Quasar gives role and name of a slider to its outer element, and the focus to an inner one. Screen readers read those of the
// element that has the focus (ui/slider.py).
id => {
  const MOVED = ["role", "aria-label"];
  const COPIED = ["aria-valuemin", "aria-valuemax", "aria-valuenow", "aria-disabled", "aria-readonly"];
  let attempts = 100;

  function begin() {
    const outer = document.getElementById(id), inner = outer?.querySelector(".q-slider__track-container");
    if (!inner) {
      if (attempts-- > 0) setTimeout(begin, 100); // the page is not drawn yet
      return;
    }
    const update = () => {
      for (const name of MOVED) {
        if (!outer.hasAttribute(name)) continue;
        inner.setAttribute(name, outer.getAttribute(name));
        outer.removeAttribute(name);
      }
      for (const name of COPIED) {
        if (outer.hasAttribute(name)) inner.setAttribute(name, outer.getAttribute(name));
        else inner.removeAttribute(name);
      }
    };
    new MutationObserver(update).observe(outer, { attributes: true });
    update();
  }

  begin();
}
