// The true objects of the simulated sensor: drag, turn, reshape, by pointer and by keyboard.

import { make } from "./surface.js";

const TURN = Math.PI / 36;
const centre = (ring) => {
  const n = ring.length;
  return [ring.reduce((sum, p) => sum + p[0], 0) / n, ring.reduce((sum, p) => sum + p[1], 0) / n];
};
const turned = (ring, angle) => {
  const [cx, cy] = centre(ring), c = Math.cos(angle), s = Math.sin(angle);
  return ring.map(([x, y]) => [cx + c * (x - cx) - s * (y - cy), cy + s * (x - cx) + c * (y - cy)]);
};

export class Objects {
  // `changed` is called with all objects whenever the user changed one.
  constructor(surface, changed) {
    this.surface = surface;
    this.changed = changed;
    this.rings = [];
    this.chosen = { object: 0, corner: null };
    this.held = null;
    this.touched = 0;
    const svg = surface.svg;
    svg.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { this.held = null; });
    svg.addEventListener("wheel", (event) => {
      if (event.target.dataset.object === undefined) return;
      event.preventDefault();
      this.chosen = { object: +event.target.dataset.object, corner: null };
      this.turn(event.deltaY > 0 ? -TURN : TURN);
    }, { passive: false });
    svg.addEventListener("dblclick", (event) => {
      if (event.target.dataset.object === undefined) return;
      this.chosen = { object: +event.target.dataset.object, corner: null };
      this.addCorner(surface.point(event));
    });
  }

  // What the server has counts, except while, or just after, the user moves something here.
  take(rings) {
    if (this.held || performance.now() - this.touched < 500) return;
    if (JSON.stringify(rings) === JSON.stringify(this.rings)) return;
    this.rings = rings;
    this.draw();
  }

  change(rings) {
    this.touched = performance.now();
    this.rings = rings;
    this.draw();
    this.changed(rings);
  }

  get ring() { return this.rings[this.chosen.object]; }

  replace(ring) { this.change(this.rings.map((r, i) => (i === this.chosen.object ? ring : r))); }

  draw() {
    const { truths, handles } = this.surface.layers, { px } = this.surface;
    if (!px) return;
    const wanted = [];
    this.rings.forEach((ring, object) => {
      wanted.push({ object, corner: null });
      ring.forEach((_, corner) => wanted.push({ object, corner }));
    });
    const key = ({ object, corner }) => `${object}.${corner ?? ""}`;
    const there = new Map([...truths.children, ...handles.children].map((e) => [e.dataset.key, e]));
    for (const item of wanted) {
      const { object, corner } = item, ring = this.rings[object];
      let e = there.get(key(item));
      there.delete(key(item));
      if (!e) e = this.element(item, key(item));
      const on = object === this.chosen.object && corner === this.chosen.corner;
      if (corner === null) {
        e.setAttribute("class", on ? "truth chosen" : "truth");
        e.setAttribute("d", this.surface.path(ring));
      } else {
        e.setAttribute("class", on ? "handle chosen" : "handle");
        e.setAttribute("cx", ring[corner][0]);
        e.setAttribute("cy", this.surface.y(ring[corner][1]));
        e.setAttribute("r", 12.5 * px); // 24 pixels wide at least, for a finger
      }
    }
    there.forEach((e) => e.remove());
  }

  element(item, key) {
    const { truths, handles } = this.surface.layers, { object, corner } = item;
    const name = corner === null ? `object ${object + 1}: arrows move, brackets turn` : `corner ${corner + 1} of object ${object + 1}`;
    const e = make(corner === null ? "path" : "circle", { tabindex: 0, role: "button", "aria-label": name, "vector-effect": "non-scaling-stroke" }, corner === null ? truths : handles);
    Object.assign(e.dataset, { key, object, ...(corner === null ? {} : { corner }) });
    e.addEventListener("focus", () => { this.chosen = item; this.draw(); });
    e.addEventListener("keydown", (event) => this.key(event));
    e.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      e.focus({ preventScroll: true });
      this.surface.svg.setPointerCapture(event.pointerId);
      this.held = { ...item, from: this.surface.point(event), ring: this.rings[object] };
    });
    return e;
  }

  move(event) {
    if (!this.held) return;
    const [x, y] = this.surface.point(event), { from, ring, corner } = this.held;
    const shifted = ([a, b]) => [a + x - from[0], b + y - from[1]];
    this.replace(ring.map((p, i) => (corner === null || corner === i ? shifted(p) : p)));
  }

  key(event) {
    const step = (event.shiftKey ? 10 : 1) * 0.005 * Math.max(this.surface.width, this.surface.length);
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    const { corner } = this.chosen;
    if (way) {
      const shifted = ([a, b]) => [a + step * way[0], b + step * way[1]];
      this.replace(this.ring.map((p, i) => (corner === null || corner === i ? shifted(p) : p)));
    } else if (event.key === "[" || event.key === "]") this.turn(event.key === "[" ? TURN : -TURN);
    else if (event.key === "+" || event.key === "Insert") this.addCorner();
    else if (event.key === "Delete" || event.key === "Backspace") this.remove();
    else return;
    event.preventDefault();
  }

  turn(angle) { if (this.ring) this.replace(turned(this.ring, angle)); }

  // Put a corner at a place, or in the middle after the chosen one.
  addCorner(place) {
    const ring = this.ring;
    if (!ring) return;
    let after = this.chosen.corner ?? 0;
    if (place) {
      const far = ring.map((p, i) => {
        const q = ring[(i + 1) % ring.length], dx = q[0] - p[0], dy = q[1] - p[1];
        const t = Math.min(1, Math.max(0, ((place[0] - p[0]) * dx + (place[1] - p[1]) * dy) / (dx * dx + dy * dy || 1)));
        return Math.hypot(p[0] + t * dx - place[0], p[1] + t * dy - place[1]);
      });
      after = far.indexOf(Math.min(...far));
    }
    const a = ring[after], b = ring[(after + 1) % ring.length];
    const new_ = place ?? [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
    this.replace([...ring.slice(0, after + 1), new_, ...ring.slice(after + 1)]);
  }

  remove() {
    const { object, corner } = this.chosen, ring = this.ring;
    if (!ring) return;
    if (corner !== null && ring.length > 3) {
      this.chosen = { object, corner: null };
      this.replace(ring.filter((_, i) => i !== corner));
    } else {
      this.chosen = { object: 0, corner: null };
      this.change(this.rings.filter((_, i) => i !== object));
    }
    this.focusChosen();
  }

  // Put the focus on what is chosen now, or where a new object comes from.
  focusChosen() {
    const { truths } = this.surface.layers;
    const next = [...truths.children].find((e) => e.dataset.key === `${this.chosen.object}.`);
    (next ?? document.getElementById("add")).focus({ preventScroll: true });
  }

  add() {
    const { width: w, length: h } = this.surface, at = this.rings.length % 2 ? 0.25 : 0.75;
    const size = 0.14 * Math.min(w, h);
    const x = this.surface.left + at * w, y = this.surface.top - 0.5 * h;
    const corner = (part) => [x + size * Math.cos(part * Math.PI), y + size * Math.sin(part * Math.PI)];
    this.chosen = { object: this.rings.length, corner: null };
    this.change([...this.rings, [0.1, 0.8, 1.45].map(corner)]);
  }
}
