// Solids pressed into the simulated skin: chosen, dragged on the unrolled skin, turned, pressed deeper or less.

import { make } from "./surface.js";

const TURN = Math.PI / 36;
const KEYS = ["solid", "x_mm", "y_mm", "depth_mm", "turn_deg", "size_mm"];
const asked = (one) => Object.fromEntries(KEYS.map((key) => [key, one[key]]));

export class Solids {
  // `changed` is called with all solids whenever the user changed one, `chose` with the one that is chosen.
  constructor(surface, changed, chose) {
    Object.assign(this, { surface, changed, chose, solids: [], chosen: 0, held: null, touched: 0 });
    const { svg } = surface;
    svg.addEventListener("pointermove", (event) => {
      if (!this.held) return;
      const [x, y] = surface.point(event), { from, at } = this.held;
      this.set({ x_mm: at[0] + x - from[0], y_mm: at[1] + y - from[1] });
    });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { this.held = null; });
    svg.addEventListener("wheel", (event) => {
      if (event.target.dataset.solid === undefined) return;
      event.preventDefault();
      this.chosen = +event.target.dataset.solid;
      this.turn(event.deltaY > 0 ? -TURN : TURN);
    }, { passive: false });
  }

  get one() { return this.solids[this.chosen]; }

  // What the server has counts, except while, or just after, the user moves something here.
  take(solids) {
    if (this.held || performance.now() - this.touched < 500) return;
    const key = JSON.stringify(solids);
    if (key === this.key) return;
    this.key = key;
    this.solids = solids;
    this.chosen = Math.min(this.chosen, Math.max(solids.length - 1, 0));
    this.draw();
  }

  change(solids) {
    this.touched = performance.now();
    this.key = "";
    this.solids = solids;
    this.draw();
    this.changed(solids.map(asked));
  }

  set(values) {
    if (!this.one) return;
    const now = { ...this.one, ...values }, { width, length, sensor } = this.surface;
    now.x_mm = sensor.closed ? (now.x_mm % width + width) % width : Math.min(Math.max(now.x_mm, 0), width);
    now.y_mm = Math.min(Math.max(now.y_mm, 0), length);
    this.change(this.solids.map((one, i) => (i === this.chosen ? now : one)));
  }

  turn(angle) { if (this.one) this.set({ turn_deg: +(this.one.turn_deg + (angle * 180) / Math.PI).toFixed(3) }); }

  add() {
    const { width, length } = this.surface, last = this.one || { solid: "sphere", depth_mm: 1, turn_deg: 0, size_mm: 4 };
    this.chosen = this.solids.length;
    this.change([...this.solids, { ...last, x_mm: ((last.x_mm ?? 0) + 0.5 * width) % width, y_mm: 0.4 * length }]);
  }

  remove() {
    this.change(this.solids.filter((_, i) => i !== this.chosen));
    this.chosen = 0;
  }

  draw() {
    const { truths, handles } = this.surface.layers, { px } = this.surface;
    if (!px) return;
    truths.replaceChildren(...this.solids.flatMap((one, i) => (one.rings || []).map((ring) => make("path", {
      class: i === this.chosen ? "truth chosen" : "truth", "vector-effect": "non-scaling-stroke", "pointer-events": "none",
      d: `M${ring.map(([x, y]) => `${x} ${this.surface.y(y)}`).join("L")}` }))));
    while (handles.childElementCount > this.solids.length) handles.lastElementChild.remove();
    while (handles.childElementCount < this.solids.length) this.handle(handles.childElementCount);
    this.solids.forEach((one, i) => {
      const e = handles.children[i];
      e.setAttribute("class", i === this.chosen ? "handle chosen" : "handle");
      e.setAttribute("aria-label", `${one.solid} ${i + 1}: arrows move, brackets turn, plus and minus press`);
      e.setAttribute("cx", one.x_mm);
      e.setAttribute("cy", this.surface.y(one.y_mm));
      e.setAttribute("r", 13.5 * px); // 24 pixels wide at least, for a finger
    });
    this.chose(this.one);
  }

  handle(i) {
    const e = make("circle", { tabindex: 0, role: "button", "vector-effect": "non-scaling-stroke" }, this.surface.layers.handles);
    e.dataset.solid = i;
    e.addEventListener("focus", () => { this.chosen = i; this.draw(); });
    e.addEventListener("keydown", (event) => this.press(event));
    e.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      e.focus({ preventScroll: true });
      this.surface.svg.setPointerCapture(event.pointerId);
      this.held = { from: this.surface.point(event), at: [this.one.x_mm, this.one.y_mm] };
    });
  }

  press(event) {
    const step = (event.shiftKey ? 10 : 1) * 0.005 * Math.max(this.surface.width, this.surface.length);
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (way) this.set({ x_mm: this.one.x_mm + step * way[0], y_mm: this.one.y_mm + step * way[1] });
    else if (event.key === "[" || event.key === "]") this.turn(event.key === "[" ? TURN : -TURN);
    else if (event.key === "+" || event.key === "-") this.set({ depth_mm: +(Math.max(this.one.depth_mm + (event.key === "+" ? 0.1 : -0.1), 0.1)).toFixed(2) });
    else if (event.key === "Delete" || event.key === "Backspace") this.remove();
    else return;
    event.preventDefault();
  }
}
