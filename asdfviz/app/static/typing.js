// Figures to type: the selected part's pose in the panel, and the number of a frame. Enter or leaving the
// field takes it, Escape leaves all as it was. Loaded after app.js.
(() => {
  "use strict";
  const NS = window.asdfviz;
  const isTyped = (target) => target instanceof Element && target.matches("[data-typed] input");

  // ---- a pose: what was changed is sent, as it was typed
  document.addEventListener("change", ({ target }) => {
    if (!isTyped(target) || target.value.trim() === target.dataset.default) return;
    const action = JSON.parse(target.closest("[data-typed]").dataset.typed);
    NS.send({ ...action, options: { [target.dataset.option]: target.value.trim() } });
    target.value = target.dataset.default; // until the server says otherwise
  });
  document.addEventListener("keydown", (event) => {
    if (!isTyped(event.target)) return;
    event.stopPropagation(); // figures are no commands
    if (event.key === "Escape") event.target.value = event.target.dataset.default;
    if (event.key === "Escape" || event.key === "Enter") event.target.blur();
  }, { capture: true });
  document.addEventListener("focusin", ({ target }) => { if (isTyped(target)) target.select(); });

  // ---- a frame: its number becomes a field, and the nearest frame that there is gets shown
  const numbers = () => {
    const rows = NS.root.querySelector("[data-numbers]");
    return rows ? JSON.parse(rows.dataset.numbers) : [];
  };
  const seek = (said) => {
    const wanted = Number(said);
    const known = numbers();
    if (!said || !Number.isFinite(wanted) || !known.length) return;
    const off = known.map((number) => Math.abs(number - wanted));
    NS.send({ kind: "Seek", place: off.indexOf(Math.min(...off)) });
  };
  NS.root.addEventListener("click", (event) => {
    const shown = event.target.closest(".ax-frame b");
    if (!shown || shown.parentElement.querySelector("input")) return;
    const field = document.createElement("input");
    Object.assign(field, { type: "text", inputMode: "numeric", value: shown.textContent });
    field.setAttribute("aria-label", "Frame to show");
    field.dataset.testid = "frame-number";
    field.style.width = `${shown.textContent.length + 2}ch`;
    shown.before(field);
    shown.hidden = true;
    field.select();
    let isOpen = true;
    const close = (takes) => {
      if (!isOpen) return;
      isOpen = false; // removing it takes the focus away, which closes it once more
      shown.hidden = false;
      field.remove();
      if (takes) seek(field.value.trim());
    };
    field.addEventListener("keydown", (key) => {
      key.stopPropagation();
      if (key.key === "Enter" || key.key === "Escape") close(key.key === "Enter");
    });
    field.addEventListener("blur", () => close(false));
  });
})();
