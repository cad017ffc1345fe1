"use strict";
// Each picture is one <svg>: its viewBox is the window that is shown, and all of it lies within the first one.
for (const box of document.querySelectorAll("figure .wide, figure .narrow")) {
  const svg = box.querySelector("svg");
  if (!svg) continue;
  const view = svg.viewBox.baseVal, whole = { x: view.x, y: view.y, w: view.width, h: view.height };
  const most = 40, held = new Map();
  let from = null, start = null, pinch = 0;
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
  const zoomed = () => view.width < 0.999 * whole.w;
  function show(x, y, w) {
    w = clamp(w, whole.w / most, whole.w);
    const h = w * whole.h / whole.w;
    svg.setAttribute("viewBox", [clamp(x, whole.x, whole.x + whole.w - w), clamp(y, whole.y, whole.y + whole.h - h), w, h].join(" "));
    box.classList.toggle("zoomed", zoomed());
    reset.disabled = out.disabled = !zoomed();
  }
  const all = () => show(whole.x, whole.y, whole.w);
  function zoom(factor, at) {
    at = at || { x: view.x + view.width / 2, y: view.y + view.height / 2 };
    const w = clamp(view.width / factor, whole.w / most, whole.w), share = w / view.width;
    show(at.x - (at.x - view.x) * share, at.y - (at.y - view.y) * share, w);
  }
  function spot(event) {
    const place = svg.getBoundingClientRect();
    return { x: view.x + (event.clientX - place.left) / place.width * view.width,
             y: view.y + (event.clientY - place.top) / place.height * view.height };
  }
  const bar = document.createElement("div");
  bar.className = "zoom";
  function button(sign, told, act) {
    const made = document.createElement("button");
    made.type = "button"; made.textContent = sign; made.title = told; made.setAttribute("aria-label", told);
    made.addEventListener("click", act);
    bar.append(made);
    return made;
  }
  button("+", "Zoom in", () => zoom(1.6));
  const out = button("\u2212", "Zoom out", () => zoom(1 / 1.6));
  const reset = button("Reset", "Show the whole picture", all);
  out.disabled = reset.disabled = true;
  // The values under the pointer, from where each panel lies in the picture.
  const panels = JSON.parse(svg.dataset.axes), told = document.createElement("output");
  bar.prepend(told);
  function read(event) {
    const at = spot(event), panel = panels.find(p => at.x >= p.box[0] && at.x <= p.box[2] && at.y >= p.box[1] && at.y <= p.box[3]);
    told.textContent = !panel ? "" : ["x", "y"].filter(side => panel[side]).map(side => {
      const [from, to, low, high, log, label] = panel[side], share = (at[side] - from) / (to - from);
      const value = log ? low * (high / low) ** share : low + share * (high - low);
      return (label ? label + ": " : "") + Number(value.toPrecision(4));
    }).join(", ");
  }
  svg.addEventListener("pointermove", read);
  svg.addEventListener("pointerleave", () => { told.textContent = ""; });
  const mark = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  mark.setAttribute("class", "mark");
  box.append(bar);
  svg.tabIndex = 0;
  // The page must still scroll: the wheel zooms with Ctrl, or once the picture was clicked.
  svg.addEventListener("wheel", event => {
    if (!event.ctrlKey && !event.metaKey && document.activeElement !== svg) return;
    if (event.deltaY > 0 && !zoomed()) return;
    event.preventDefault();
    zoom(Math.exp(-clamp(event.deltaY, -120, 120) / 400), spot(event));
  }, { passive: false });
  svg.addEventListener("pointerdown", event => {
    if (event.button) return;
    held.set(event.pointerId, event);
    from = spot(event); start = { x: view.x, y: view.y, cx: event.clientX, cy: event.clientY };
    if (event.pointerType === "mouse") { svg.setPointerCapture(event.pointerId); svg.focus({ preventScroll: true }); event.preventDefault(); }
  });
  svg.addEventListener("pointermove", event => {
    if (!held.has(event.pointerId) || !from) return;
    held.set(event.pointerId, event);
    const place = svg.getBoundingClientRect();
    if (held.size === 2) {
      const [a, b] = [...held.values()], apart = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      if (pinch) zoom(apart / pinch, spot({ clientX: (a.clientX + b.clientX) / 2, clientY: (a.clientY + b.clientY) / 2 }));
      pinch = apart;
    } else if (event.shiftKey || event.pointerType !== "mouse") {
      if (zoomed()) show(start.x - (event.clientX - start.cx) / place.width * view.width, start.y - (event.clientY - start.cy) / place.height * view.height, view.width);
    } else {
      const to = spot(event);
      for (const [name, value] of [["x", Math.min(from.x, to.x)], ["y", Math.min(from.y, to.y)], ["width", Math.abs(to.x - from.x)], ["height", Math.abs(to.y - from.y)]]) mark.setAttribute(name, value);
      svg.append(mark);
    }
  });
  function released(event) {
    const to = spot(event), drawn = mark.isConnected;
    held.delete(event.pointerId); pinch = 0; mark.remove();
    if (!from || !drawn) { from = null; return; }
    const w = Math.abs(to.x - from.x), h = Math.abs(to.y - from.y), least = 0.01 * view.width, middle = { x: (from.x + to.x) / 2, y: (from.y + to.y) / 2 };
    from = null;
    if (event.type === "pointerup" && Math.max(w, h) > least) {
      const wide = Math.max(w, h * whole.w / whole.h);
      show(middle.x - wide / 2, middle.y - wide * whole.h / whole.w / 2, wide);
    }
  }
  svg.addEventListener("pointerup", released);
  svg.addEventListener("pointercancel", released);
  svg.addEventListener("dblclick", all);
  svg.addEventListener("keydown", event => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (event.key === "+" || event.key === "=") zoom(1.6);
    else if (event.key === "-") zoom(1 / 1.6);
    else if (event.key === "0" || event.key === "Escape") all();
    else if (step && zoomed()) show(view.x + 0.15 * step[0] * view.width, view.y + 0.15 * step[1] * view.height, view.width);
    else return;
    event.preventDefault();
  });
  addEventListener("beforeprint", all);
}
