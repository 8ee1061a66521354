// Buttons that act while they are held, by pointer, touch, Space or Enter. They are released in every case in which the
// user lets go. The script may be run more than once (ui/hold.py).
(() => {
  if (window.okHold) return;
  window.okHold = true;
  let held = null;

  function press(button) {
    if (held || button.getAttribute("aria-disabled") === "true" || !window.socket?.connected) return;
    held = button;
    button.classList.add("ok-held");
    emitEvent("ok-hold", { key: button.dataset.hold });
  }

  function release(key = "") {
    if (!held) return;
    held.classList.remove("ok-held");
    held = null;
    emitEvent("ok-hold", { key });
  }

  const target = (event) => event.target.closest?.("[data-hold]");
  document.addEventListener("pointerdown", (event) => {
    const button = target(event);
    if (!button || event.button !== 0) return;
    if (event.target.hasPointerCapture?.(event.pointerId)) event.target.releasePointerCapture(event.pointerId);
    press(button);
  });
  document.addEventListener("pointerup", () => release());
  document.addEventListener("pointercancel", () => release());
  document.addEventListener("pointerout", (event) => {
    if (held && target(event) === held && !held.contains(event.relatedTarget)) release();
  });
  document.addEventListener("contextmenu", (event) => {
    if (target(event)) event.preventDefault();
    release();
  });
  document.addEventListener("keydown", (event) => {
    const button = target(event);
    if (!button || (event.key !== " " && event.key !== "Enter")) return;
    event.preventDefault();
    if (!event.repeat) press(button);
  });
  document.addEventListener("keyup", () => release());
  document.addEventListener("focusout", (event) => {
    if (target(event) === held) release();
  });
  document.addEventListener("visibilitychange", () => document.hidden && release("gone"));
  window.addEventListener("blur", () => release());
  window.addEventListener("pagehide", () => release("gone"));
})();
