// The page's own half of the app: puts the server's HTML around viser's canvas, and sends what is
// pressed, dragged or scrolled back through a hidden field (see bridge.py). No state lives here but
// what a hand is doing at this moment.
(() => {
  "use strict";
  if (window.asdfviz) return;

  const NS = (window.asdfviz = { view: {}, bridge: null, seeking: false });
  let counter = 0;

  // ---- the frame around the picture
  const root = document.createElement("div");
  root.id = "asdf";
  root.innerHTML = `
    <header class="ax-top"><div class="ax-bar-main" data-slot="top"></div><div data-slot="tabs"></div></header>
    <section class="ax-bottom" aria-label="Timeline">
      <div class="ax-controls">
        <div class="ax-controls-main" data-slot="controls"></div>
        <label class="ax-opacity" title="How solid the meshes are"><span>Opacity</span>
          <input type="range" min="0.05" max="1" step="0.05" data-testid="opacity"></label>
      </div>
      <div class="tl" data-testid="timeline">
        <div data-slot="timeline"></div><i class="tl-range" hidden></i>
      </div>
      <div class="tl-tip" data-testid="tip" hidden></div>
    </section>
    <div class="ax-offline" hidden>Connection lost. Every correction up to here is saved. Trying again …</div>
    <div data-slot="card"></div>`;
  NS.root = root;
  const slot = (name) => root.querySelector(`[data-slot="${name}"]`);
  const range = root.querySelector(".tl-range");
  const opacity = root.querySelector(".ax-opacity input");

  // ---- to the server
  const send = (action) => {
    const mutable = window.__viserMutable;
    if (!NS.bridge || !mutable) return;
    counter += 1;
    const value = JSON.stringify({ ...action, n: counter });
    mutable.sendMessage({ type: "GuiUpdateMessage", uuid: NS.bridge, updates: { value } });
  };
  NS.send = send;

  // At most one message a frame: only the last of a drag matters.
  const waiting = new Map();
  const sendSoon = (action, merge) => {
    const before = waiting.get(action.kind);
    if (before === undefined) {
      requestAnimationFrame(() => {
        const last = waiting.get(action.kind);
        waiting.delete(action.kind);
        send(last);
      });
    }
    waiting.set(action.kind, before && merge ? merge(before, action) : action);
  };
  NS.sendSoon = sendSoon;

  // ---- from the server: templates are put into their slots
  const applyView = (data) => {
    const previous = NS.view;
    NS.view = data;
    root.dataset.mode = data.mode;
    document.title = `${data.title} · asdfviz`;
    if (!NS.seeking) root.style.setProperty("--cursor", data.cursor);
    if (document.activeElement !== opacity) opacity.value = data.opacity;
    const first = Number(data.first), last = Number(data.last), count = Number(data.count);
    range.hidden = first < 0;
    root.style.setProperty("--range-first", first / count);
    root.style.setProperty("--range-size", (last + 1 - first) / count);
    if (previous.mode !== data.mode || previous.zoom !== data.zoom) guardCamera();
  };

  // A new connection begins with a new view: go on as we were before the old one was lost, unless
  // another sequence is served now, or before the page was loaded again while it was open.
  const STORED = "asdfviz-place";
  const stored = (opened) => {
    try {
      const kept = JSON.parse(sessionStorage.getItem(STORED)) || {};
      sessionStorage.removeItem(STORED);  // a copy of this tab is another page
      return kept.opened === opened ? kept.view : undefined;
    } catch {
      return undefined;  // the browser keeps nothing
    }
  };
  const resume = ({ uuid, opened, sequence, keys }) => {
    if (NS.bridge === uuid) return;
    NS.keyNames = JSON.parse(keys);
    const seen = NS.sequence === sequence ? NS.view.kept : undefined;
    const kept = NS.bridge === null ? stored(opened) : seen;
    Object.assign(NS, { bridge: uuid, opened, sequence });
    if (kept) send({ kind: "Resume", ...JSON.parse(kept) });
  };
  window.addEventListener("pagehide", () => {
    if (!NS.view.kept) return;
    try {
      sessionStorage.setItem(STORED, JSON.stringify({ opened: NS.opened, view: NS.view.kept }));
    } catch {
      // then the page begins anew
    }
  });

  const mount = (template) => {
    const name = template.dataset.asdfMount;
    if (name === "bridge") resume(template.dataset);
    else if (name === "view") applyView({ ...template.dataset });
    else {
      const target = slot(name);
      if (!target) return;
      target.innerHTML = template.innerHTML;
      target.querySelectorAll("[data-option]").forEach(markChanged);
    }
  };

  const mountAll = (node) => {
    if (node.nodeType !== 1) return;
    if (node.matches("[data-asdf-mount]")) mount(node);
    else node.querySelectorAll("[data-asdf-mount]").forEach(mount);
  };
  // The palette is viser's, which calls keys as it does itself: "Watch  (Shift+pagedown)".
  const nameKey = (said) => {
    const named = said.textContent.replace(/(\w+)\)$/, (all, key) =>
      NS.keyNames && key in NS.keyNames ? `${NS.keyNames[key]})` : all);
    if (named !== said.textContent) said.firstChild.data = named;
  };
  const nameKeys = (node) => {
    const element = node.nodeType === 1 ? node : node.parentElement;
    if (!element || !element.closest(".mantine-Spotlight-root, [class*='Spotlight']")) return;
    element.querySelectorAll(".mantine-Spotlight-actionDescription").forEach(nameKey);
    if (element.matches(".mantine-Spotlight-actionDescription")) nameKey(element);
  };
  new MutationObserver((records) => {
    for (const { target, addedNodes } of records) {
      addedNodes.forEach(mountAll);
      nameKeys(target);
    }
  }).observe(document.documentElement, { childList: true, subtree: true, characterData: true });

  // ---- layout: the canvas keeps clear of the bars, the tabs stand over the panel
  const layout = () => {
    const canvas = window.__viserMutable && window.__viserMutable.canvas;
    const dock = document.querySelector("[data-dock-root]");
    if (!canvas || !dock) return;
    const centre = [...dock.children].find((child) => child.contains(canvas));
    if (centre) centre.dataset.asdf = "canvas";
    const panel = dock.querySelector("[data-dock-region]");
    const width = panel ? panel.getBoundingClientRect().width : 0;
    root.style.setProperty("--panel", `${width}px`);
    const bottom = root.querySelector(".ax-bottom").getBoundingClientRect().height;
    document.documentElement.style.setProperty("--asdf-bottom", `${Math.ceil(bottom)}px`);
    if (panel && !panel.dataset.asdfSeen) {
      panel.dataset.asdfSeen = "1";
      new ResizeObserver(layout).observe(panel);
    }
  };
  new ResizeObserver(layout).observe(root.querySelector(".ax-bottom"));

  // ---- AR: the camera's centre is pinned by the server; here it turns by hand and nothing else
  const guardCamera = () => {
    const mutable = window.__viserMutable;
    const control = mutable && mutable.cameraControl;
    if (!control || !NS.view.mode) return;
    if (!NS.usual) {
      NS.usual = {
        buttons: { ...control.mouseButtons },
        touches: { ...control.touches },
        azimuth: control.azimuthRotateSpeed,
        polar: control.polarRotateSpeed,
      };
    }
    if (NS.view.mode === "ar") {
      const turn = Number(NS.view.zoom) > 1.001 ? NS.usual.buttons.left : 0;
      Object.assign(control.mouseButtons, { left: turn, middle: turn, right: turn, wheel: 0 });
      Object.assign(control.touches, { one: turn ? NS.usual.touches.one : 0, two: 0, three: 0 });
      // One pixel of the hand is one pixel of the picture, which follows the hand.
      const speed = -((mutable.camera.fov * Math.PI) / 180) / (2 * Math.PI);
      turnBy(control, speed, speed);
    } else {
      Object.assign(control.mouseButtons, NS.usual.buttons);
      Object.assign(control.touches, NS.usual.touches);
      turnBy(control, NS.usual.azimuth, NS.usual.polar);
    }
  };
  const turnBy = (control, azimuth, polar) => {
    // Whoever sets them has viser draw for a quarter of a second, though nothing changed.
    if (control.azimuthRotateSpeed !== azimuth) control.azimuthRotateSpeed = azimuth;
    if (control.polarRotateSpeed !== polar) control.polarRotateSpeed = polar;
  };

  const CAMERA_KEYS = new Set(["KeyW", "KeyA", "KeyS", "KeyD", "KeyQ", "KeyE",
    "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight"]);
  // viser's hotkeys listen on the root element, its flying camera on the document above it.
  document.documentElement.addEventListener("keydown", (event) => {
    if (NS.view.mode === "ar" && CAMERA_KEYS.has(event.code)) event.stopPropagation();
  });

  // The palette is viser's: keys are for its search, also after a click beside that.
  window.addEventListener("keydown", (event) => {
    const search = document.querySelector("input.mantine-Spotlight-search");
    if (!search || event.target === search || event.key === "Escape") return;
    event.stopPropagation();
    search.focus();
  }, { capture: true });

  // viser knows no key for a question mark.
  window.addEventListener("keydown", (event) => {
    if (event.key !== "?" || event.ctrlKey || event.metaKey || event.altKey) return;
    const isTyped = event.target instanceof Element && event.target.matches("input:not([type=range]), select, textarea");
    if (!isTyped && !root.querySelector(".ax-form")) send({ kind: "ToggleKeys" });
  });

  document.addEventListener("wheel", (event) => {
    const canvas = window.__viserMutable && window.__viserMutable.canvas;
    if (NS.view.mode !== "ar" || event.target !== canvas) return;
    event.preventDefault();
    event.stopPropagation();
    const box = canvas.getBoundingClientRect();
    const lines = event.deltaMode === 1 ? 16 : 1;
    sendSoon({
      kind: "Zoom",
      factor: Math.exp(-Math.max(-240, Math.min(240, event.deltaY * lines)) * 0.0018),
      x: ((event.clientX - box.left) / box.width) * 2 - 1,
      y: ((event.clientY - box.top) / box.height) * 2 - 1,
    }, (before, after) => ({ ...after, factor: before.factor * after.factor }));
  }, { capture: true, passive: false });

  // ---- buttons: at the press, because the element may be renewed before the release
  const press = (element) => {
    const action = JSON.parse(element.dataset.act);
    const form = element.matches(".ax-submit") && element.closest("[data-form]");
    if (form) action.options = changedOptions(form);
    send(action);
  };

  // ---- forms: their fields live here until they are sent, and only what differs is sent
  const fields = (form) => [...form.querySelectorAll("[data-option]")];
  const changedOptions = (form) => Object.fromEntries(fields(form)
    .filter((field) => field.value.trim() !== field.dataset.default)
    .map((field) => [field.dataset.option, field.value.trim()]));
  const markChanged = (field) =>
    field.closest(".ax-option").classList.toggle("ax-changed", field.value.trim() !== field.dataset.default);
  root.addEventListener("input", (event) => {
    if (event.target.matches("[data-option]")) markChanged(event.target);
  });
  root.addEventListener("keydown", (event) => {
    const form = event.target.closest("[data-form]");
    if (!form || !event.target.matches("input, select")) return;
    if (event.key === "Enter") press(form.querySelector(".ax-submit"));
    if (event.key === "Escape") {
      event.target.blur();
      send({ kind: "Cancel" });
    }
  });
  root.addEventListener("click", (event) => {
    if (!event.target.closest(".ax-reset")) return;
    fields(event.target.closest("[data-form]")).forEach((field) => {
      field.value = field.dataset.default;
      markChanged(field);
    });
  });

  document.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !(event.target instanceof Element)) return;
    const element = event.target.closest("[data-act]");
    if (!element) return;
    event.preventDefault();
    if (document.activeElement instanceof HTMLElement) document.activeElement.blur();
    press(element);
  });
  document.addEventListener("keydown", (event) => {
    const element = document.activeElement;
    if ((event.key === "Enter" || event.key === " ") && element && element.dataset.act) {
      event.preventDefault();
      event.stopPropagation();
      press(element);
    }
  }, true);
  opacity.addEventListener("input", () => sendSoon({ kind: "SetOpacity", opacity: Number(opacity.value) }));
  opacity.addEventListener("change", () => opacity.blur());
  // A slider that is pressed but not moved does not change, and would keep the arrow keys.
  window.addEventListener("pointerup", () => {
    if (document.activeElement?.matches("input[type=range]")) document.activeElement.blur();
  }, { capture: true });

  // ---- the server has gone: viser says so in its own header, which we do not show
  const offline = root.querySelector(".ax-offline");
  const watch = () => {
    const header = document.querySelector("[data-dock-group] > :first-child");
    const lost = Boolean(header && /Connecting\.\.\.|Inactive/.test(header.textContent));
    offline.hidden = !lost;
  };

  const start = () => {
    document.body.appendChild(root);
    document.querySelectorAll("[data-asdf-mount]").forEach(mount);
    setInterval(() => { layout(); guardCamera(); watch(); }, 500);
  };
  if (document.body) start();
  else document.addEventListener("DOMContentLoaded", start);
})();
