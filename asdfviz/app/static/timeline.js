// The hand on the timeline: click or drag seeks, with Shift it marks frames, and hovering tells what is
// there. Loaded after app.js, which puts the rows into place.
(() => {
  "use strict";
  const NS = window.asdfviz;
  const timeline = NS.root.querySelector(".tl");
  const tip = NS.root.querySelector(".tl-tip");

  const strip = () => timeline.querySelector(".tl-strip");
  const frameAt = (event) => {
    const box = strip().getBoundingClientRect();
    const count = Number(NS.view.count);
    const share = (event.clientX - box.left) / box.width;
    return Math.max(0, Math.min(count - 1, Math.floor(share * count)));
  };
  // The server's answers lag behind the hand: until it lets go, the cursor stands where the hand has put it.
  const show = (frame) => NS.root.style.setProperty("--cursor", (frame + 0.5) / Number(NS.view.count));
  let anchor = null, before = 0;
  const seek = (event) => {
    const frame = frameAt(event);
    if (anchor === null) {
      show(frame);
      NS.sendSoon({ kind: "Seek", place: frame });
      return;
    }
    const first = Math.min(anchor, frame), last = Math.max(anchor, frame);
    // The frame that was shown stays where the range has it; else the end in the hand is shown.
    const place = first <= before && before <= last ? before : frame;
    show(place);
    NS.sendSoon({ kind: "SetRange", first, last, place });
  };
  timeline.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !strip()) return;
    if (event.clientX < strip().getBoundingClientRect().left - 6) return;
    event.preventDefault();
    timeline.setPointerCapture(event.pointerId);
    NS.seeking = true;
    anchor = event.shiftKey ? frameAt(event) : null;
    before = Number(NS.view.place);
    seek(event);
  });
  timeline.addEventListener("pointermove", (event) => {
    if (NS.seeking) seek(event);
    else showTip(event);
  });
  const release = () => {
    NS.seeking = false;
    anchor = null;
  };
  timeline.addEventListener("pointerup", release);
  timeline.addEventListener("pointercancel", release);
  timeline.addEventListener("pointerleave", () => { tip.hidden = true; });

  const showTip = (event) => {
    const row = event.target instanceof Element ? event.target.closest(".tl-row") : null;
    if (!row || !strip()) {
      tip.hidden = true;
      return;
    }
    const frame = frameAt(event);
    const piece = event.target.closest("[data-say]");
    const sure = row.dataset.p ? JSON.parse(row.dataset.p)[frame] : null;
    const words = [row.dataset.row, `frame ${JSON.parse(row.parentElement.dataset.numbers)[frame]}`];
    if (piece) words.push(piece.dataset.say);
    if (sure !== null && sure !== undefined) words.push(`${sure} %`);
    const verdict = [...row.querySelectorAll(".tl-verdict")]
      .find(({ dataset }) => Number(dataset.first) <= frame && frame <= Number(dataset.last));
    if (verdict) words.push(verdict.dataset.also);
    tip.textContent = words.join(" · ");
    tip.hidden = false;
    // Above the controls, and out of the timeline, which cuts off what does not fit.
    const box = tip.parentElement.getBoundingClientRect();
    const width = tip.offsetWidth;
    const left = Math.max(4, Math.min(box.width - width - 4, event.clientX - box.left - width / 2));
    tip.style.left = `${left}px`;
  };
})();
