// Figures to type: the selected part's pose in the panel, and the number of a frame. Enter, or leaving the
// field, takes them; Escape leaves all as it was. What the server renews meanwhile takes neither what is
// half typed nor the keys that follow. Loaded after app.js.
(() => {
  "use strict";
  const NS = window.asdfviz;
  const hold = (place) => NS.send({ kind: "Hold", place: Number(place) });
  // An element that is renewed loses the focus as well; it is left only if it is still there.
  const whenLeft = (field, act) => setTimeout(() => {
    if (field.isConnected && document.activeElement !== field) act();
  }, 0);

  // ---- a pose: what was changed is sent, as it was typed
  const GONE_MS = 1000;
  // The place stays that of the frame in which it began: a later one may be shown until playing has stopped.
  let editing = null; // { part, place, option, value, from, to }
  let passed = null; // that place, on the way to the next field
  const typedOf = (field) => JSON.parse(field.closest("[data-typed]").dataset.typed);
  const isTyped = (target) => target instanceof Element && target.matches("[data-typed] input");
  const note = (field, place = editing.place) => {
    editing = {
      part: typedOf(field).part, place, option: field.dataset.option, value: field.value,
      from: field.selectionStart, to: field.selectionEnd,
    };
  };
  const take = (field) => {
    const typed = typedOf(field);
    if (editing && editing.option === field.dataset.option) {
      typed.place = editing.place;
      editing = null; // the next one has begun
    }
    const said = field.value.trim();
    if (said === field.dataset.default) return;
    NS.send({ ...typed, options: { [field.dataset.option]: said } });
    field.value = field.dataset.default; // until the server says otherwise
  };
  document.addEventListener("focusin", ({ target }) => {
    if (!isTyped(target) || editing) return;
    const place = passed ?? typedOf(target).place;
    hold(place);
    target.select();
    note(target, place);
  });
  for (const kind of ["input", "keyup", "pointerup"]) {
    document.addEventListener(kind, ({ target }) => { if (isTyped(target) && editing) note(target); });
  }
  document.addEventListener("focusout", ({ target }) => {
    if (isTyped(target)) whenLeft(target, () => take(target));
  });
  document.addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (!isTyped(target)) return;
    event.stopPropagation(); // figures are no commands
    if (key === "Escape") target.value = target.dataset.default;
    if (key === "Tab") {
      passed = editing?.place ?? null;
      setTimeout(() => { passed = null; }, 0);
    }
    if (key === "Enter" || key === "Tab") take(target);
    if (key === "Enter" || key === "Escape") {
      editing = null;
      target.blur();
    }
  }, { capture: true });
  const carryOn = () => {
    if (!editing || isTyped(document.activeElement)) return;
    const { part, option, value, from, to } = editing;
    const field = [...document.querySelectorAll("[data-typed] input")]
      .find((one) => typedOf(one).part === part && one.dataset.option === option);
    if (!field) {
      editing.missing ??= performance.now();
      // Taken away to be put back, or another part or tab is shown.
      if (performance.now() - editing.missing > GONE_MS) editing = null;
      return;
    }
    field.value = value;
    field.focus();
    field.setSelectionRange(from, to);
  };
  new MutationObserver(carryOn).observe(document.documentElement, { childList: true, subtree: true });

  // ---- a frame: its number becomes a field, and the nearest frame that there is gets shown
  const controls = NS.root.querySelector('[data-slot="controls"]');
  let field = null;
  const attach = () => {
    const shown = controls.querySelector(".ax-frame b");
    if (!field || field.isConnected || !shown) return;
    shown.before(field);
    shown.hidden = true;
    field.focus();
  };
  const close = (takes) => {
    const said = field.value.trim();
    const { numbers } = NS.root.querySelector("[data-numbers]").dataset;
    const shown = controls.querySelector(".ax-frame b");
    const closed = field;
    field = null;
    closed.remove();
    shown.hidden = false;
    if (!takes || !said || !Number.isFinite(Number(said))) return;
    const off = JSON.parse(numbers).map((number) => Math.abs(number - Number(said)));
    hold(off.indexOf(Math.min(...off)));
  };
  // At the press, because the number may be renewed before the release.
  controls.addEventListener("mousedown", (event) => {
    const shown = event.target.closest(".ax-frame")?.querySelector("b");
    if (!shown || field) return;
    event.preventDefault();
    field = document.createElement("input");
    Object.assign(field, { type: "text", inputMode: "numeric", value: shown.textContent });
    field.setAttribute("aria-label", "Frame to show");
    field.dataset.testid = "frame-number";
    field.style.width = `${shown.textContent.length + 2}ch`;
    const own = field;
    field.addEventListener("keydown", (event) => {
      event.stopPropagation();
      // Tab, too: a field that is renewed just then would not be told that it was left.
      if (["Enter", "Tab", "Escape"].includes(event.key)) close(event.key !== "Escape");
    });
    field.addEventListener("blur", () => whenLeft(own, () => { if (field === own) close(true); }));
    attach();
    field.select();
    hold(shown.dataset.place);
  });
  new MutationObserver(attach).observe(controls, { childList: true });
})();
