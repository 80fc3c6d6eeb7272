// The sensor's surface as SVG: strips, what was recovered. Millimetres, y upwards, so y is drawn as length - y.

const SVG = "http://www.w3.org/2000/svg";

export function make(kind, attributes, parent) {
  const element = document.createElementNS(SVG, kind);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (parent) parent.append(element);
  return element;
}

// Give a group as many children of a kind as there are items, and set each; elements are kept and used again.
function fill(group, kind, items, set) {
  while (group.childElementCount > items.length) group.lastElementChild.remove();
  while (group.childElementCount < items.length) make(kind, {}, group);
  items.forEach((item, i) => set(group.children[i], item));
}

export class Surface {
  constructor(svg) {
    this.svg = svg;
    this.layers = {};
    this.fusedOthers = []; // outlines that explain all scans as well
    for (const name of ["skin", "profiles", "truths", "alternatives", "shapes", "edges", "fused", "regions", "corners", "names", "handles"]) {
      this.layers[name] = make("g", {}, svg);
    }
    new ResizeObserver(() => this.measure()).observe(svg);
  }

  // Draw the strips of another sensor.
  begin(sensor) {
    this.sensor = sensor;
    const corners = sensor.layers.flatMap((one) => one.corners), xs = corners.map(([x]) => x), ys = corners.map(([, y]) => y);
    [this.left, this.top] = [Math.min(...xs), Math.max(...ys)];
    [this.width, this.length] = [Math.max(...xs) - this.left, this.top - Math.min(...ys)];
    const margin = 0.09 * Math.max(this.width, this.length);
    this.svg.setAttribute("viewBox", `${this.left - margin} ${-0.3 * margin} ${this.width + 2 * margin} ${this.length + 1.1 * margin}`);
    const skin = this.layers.skin;
    skin.replaceChildren();
    this.last = null;
    this.strips = []; // the corners of each, layer by layer
    const seen = { "fill-opacity": sensor.layers.length > 1 ? 0.5 : 1 }; // what lies below, too
    const [skins, touched, gaps] = Array.from({ length: 3 }, () => make("g", {}, skin));  // from below
    for (const { strips, pitch_mm, corners: [[x, y], [u, v], , [s, t]] } of sensor.layers) {
      const at = (i, far) => [x + (u - x) * i / strips + far * (s - x), y + (v - y) * i / strips + far * (t - y)];
      this.strips.push(...Array.from({ length: strips }, (_, i) => [at(i, 0), at(i + 1, 0), at(i + 1, 1), at(i, 1)]));
      make("path", { class: "skin", ...seen, d: this.path([at(0, 0), at(strips, 0), at(strips, 1), at(0, 1)]), "vector-effect": "non-scaling-stroke" }, skins);
      if (strips > 250) continue;
      const lines = Array.from({ length: strips - 1 }, (_, i) => this.path([at(i + 1, 0), at(i + 1, 1)]));
      make("path", { class: "gaps", d: lines.join(""), "stroke-width": Math.min(0.12 * pitch_mm, 1) }, gaps);
    }
    this.touched = sensor.layers.map(() => make("path", { class: "touched", ...seen }, touched));
    if (sensor.closed) {  // where the skin was cut open to lie flat
      make("path", { class: "seam", d: `M0 0V${this.length}M${this.width} 0V${this.length}`, "vector-effect": "non-scaling-stroke" }, skin);
    }
    this.axes = make("g", {}, skin);
    this.measure();
  }

  y(value) { return this.top - value; }

  // Millimetres a pixel, for what keeps its size on the screen.
  measure() {
    const map = this.svg.getScreenCTM();
    if (!map || !this.sensor) return;
    this.px = 1 / map.a;
    this.axes.replaceChildren();
    const size = 0.75 * parseFloat(getComputedStyle(document.documentElement).fontSize) * this.px;
    const text = (x, y, anchor, words) => {
      const element = make("text", { class: "axis", x, y, "font-size": size, "text-anchor": anchor }, this.axes);
      element.textContent = words;
    };
    const show = (value) => `${+value.toFixed(1)}`;
    for (const part of [0, 0.5, 1]) {
      const x = this.left + part * this.width, y = this.top - (1 - part) * this.length;
      text(x, this.length + 1.5 * size, "middle", show(x) + (part === 1 ? " mm" : ""));
      text(this.left - 0.6 * size, this.y(y) + 0.35 * size, "end", show(y));
    }
    if (this.last) this.draw(this.last);
  }

  point(event) {
    const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    return [place.x, this.y(place.y)];
  }

  // What goes on beyond the seam of a closed tube is drawn on its other side too.
  rounds(x) { return this.sensor.closed && Math.max(...x) > this.width ? [0, this.width] : [0]; }

  path(points) {
    const once = (shift) => `M${points.map(([x, y]) => `${x - shift} ${this.y(y)}`).join("L")}Z`;
    return points.length ? this.rounds(points.map(([x]) => x)).map(once).join("") : "";
  }

  draw(frame) {
    this.last = frame;
    const readings = Object.values(frame.readings)[0] || [];
    const strips = readings.map((value, i) => (value === null ? "" : this.path(this.strips[i])));
    this.touched.forEach((e, i) => e.setAttribute("d", strips.splice(0, this.sensor.layers[i].strips).join("")));
    const found = frame.objects.filter((o) => o.vertices.length);
    const fixed = "non-scaling-stroke";
    fill(this.layers.shapes, "path", found, (e, o) => {
      e.setAttribute("class", o.hidden_edges ? "shape piece" : "shape");
      e.setAttribute("data-s", o.status);
      e.setAttribute("vector-effect", fixed);
      e.setAttribute("d", this.path(o.vertices));
    });
    const tracks = frame.tracks || (frame.searching ? [] : null); // null: the computer was behind; what is drawn stays
    if (tracks) fill(this.layers.fused, "path", tracks.filter((o) => o.vertices.length), (e, o) => {
      e.setAttribute("class", "fused");
      e.setAttribute("data-s", o.status);
      e.setAttribute("vector-effect", fixed);
      e.setAttribute("d", this.path(o.vertices));
    });
    if (tracks) this.fusedOthers = tracks.flatMap((o) => o.alternatives.map(({ vertices }) => ({ vertices, fused: true })));
    // A piece that another one hides in part: its edges one by one, the hidden ones dashed.
    const edges = found.filter((o) => o.hidden_edges).flatMap((o) =>
      o.hidden_edges.map((hidden, i) => [hidden, o.vertices[i], o.vertices[(i + 1) % o.vertices.length]]));
    fill(this.layers.edges, "path", edges, (e, [hidden, [x, y], [u, v]]) => {
      e.setAttribute("class", hidden ? "edge hidden" : "edge");
      e.setAttribute("vector-effect", fixed);
      e.setAttribute("d", `M${x} ${this.y(y)}L${u} ${this.y(v)}`);
    });
    const others = found.flatMap((o) => [...(o.alternatives || []).flatMap((a) => [a, ...(a.others || []).map((vertices) => ({ vertices }))]), ...(o.bounds || []).map((vertices) => ({ vertices }))]);
    fill(this.layers.alternatives, "path", [...others, ...this.fusedOthers], (e, other) => {
      e.setAttribute("class", other.fused ? "alternative of-all" : "alternative");
      e.setAttribute("vector-effect", fixed);
      e.setAttribute("d", this.path(other.vertices));
    });
    const profiles = frame.objects.filter((o) => o.profile).map((o) => o.profile);
    fill(this.layers.profiles, "path", profiles, (e, [x, l, u]) => {
      e.setAttribute("class", "profile");
      e.setAttribute("vector-effect", fixed);
      const chain = (ends, shift) => "M" + x.map((at, i) => (ends[i] === null ? null : `${at - shift} ${this.y(ends[i])}`)).filter(Boolean).join("L");
      e.setAttribute("d", this.rounds(x).map((shift) => chain(l, shift) + chain(u, shift)).join(""));
    });
    fill(this.layers.regions, "path", found.flatMap((o) => o.regions), (e, region) => {
      e.setAttribute("class", "region");
      e.setAttribute("vector-effect", fixed);
      e.setAttribute("d", this.path(region));
    });
    const corners = found.filter((o) => o.vertices.length <= 20).flatMap((o) => o.vertices);
    fill(this.layers.corners, "circle", corners, (e, [x, y]) => {
      e.setAttribute("class", "corner");
      e.setAttribute("cx", this.sensor.closed ? x % this.width : x);
      e.setAttribute("cy", this.y(y));
      e.setAttribute("r", 1.5 * this.px);
    });
    fill(this.layers.names, "text", found, (e, o) => {
      e.setAttribute("class", "name");
      const x = o.centroid[0] ?? 0;
      e.setAttribute("x", this.sensor.closed ? x % this.width : x);
      e.setAttribute("y", this.y(o.centroid[1] ?? 0) + 5 * this.px);
      e.setAttribute("font-size", 14 * this.px);
      e.textContent = o.id;
    });
  }
}
