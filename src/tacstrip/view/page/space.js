// A curved skin in space, on a canvas: seen from far, turned by dragging it or with the arrow keys. Lines on the side
// that faces away are faint.

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const minus = (a, b) => a.map((v, i) => v - b[i]);
const mix = (a, b, t) => a.map((v, i) => v + t * (b[i] - v));
const STEP = Math.PI / 24;

export class Space {
  constructor(canvas) {
    this.canvas = canvas;
    this.view = { azimuth: -0.6, elevation: 0.5 };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.held = { x: event.clientX, y: event.clientY, ...this.view };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.held) this.turn(this.held.azimuth - (event.clientX - this.held.x) / 120, this.held.elevation + (event.clientY - this.held.y) / 120);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.held = null; });
    canvas.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!way) return;
      event.preventDefault();
      this.turn(this.view.azimuth + STEP * way[0], this.view.elevation + STEP * way[1]);
    });
    new ResizeObserver(() => { if (this.last) this.draw(this.last); }).observe(canvas);
  }

  turn(azimuth, elevation) {
    this.turned = true;
    this.view = { azimuth, elevation: Math.min(1.57, Math.max(-1.57, elevation)) };
    if (this.last) this.draw(this.last);
  }

  begin(sensor) {
    this.sensor = sensor;
    this.skin = sensor.skin;
    this.canvas.hidden = !this.skin;
    this.turned = false;
    this.last = null;
    if (!this.skin) return;
    const all = this.skin.points.flat();
    const low = [0, 1, 2].map((i) => Math.min(...all.map((p) => p[i]))), high = [0, 1, 2].map((i) => Math.max(...all.map((p) => p[i])));
    this.centre = mix(low, high, 0.5);
    this.reach = 0.5 * Math.hypot(...minus(high, low));
    const { points, lengths, outward } = this.skin, columns = points.length - 1;
    this.tiles = points.slice(1).flatMap((right, i) => right.slice(1).map((_, j) => {
      const corners = [points[i][j], right[j], right[j + 1], points[i][j + 1]];
      const normal = cross(minus(corners[2], corners[0]), minus(corners[3], corners[1])), long = outward / (Math.hypot(...normal) || 1);
      return { corners, normal: normal.map((v) => long * v), middle: mix(corners[0], corners[2], 0.5) };
    }));
    // Centre lines of the strips, where they are not too many.
    this.strips = Array.from({ length: sensor.strips <= 100 ? sensor.strips : 0 }, (_, i) => {
      const x = (i + 0.5) * sensor.layers[0].pitch_mm, long = lengths[Math.round(((i + 0.5) / sensor.strips) * columns)];
      return Array.from({ length: 13 }, (_, k) => this.at([x, (k / 12) * long]));
    });
    this.seam = sensor.closed ? points[0].map((_, j) => this.at([0, (j / (points[0].length - 1)) * lengths[0]])) : [];
  }

  // The place in space of x across the strips and y along them [mm], and the skin's normal there.
  at([x, y]) {
    const { points, lengths, outward } = this.skin, columns = points.length - 1, rows = points[0].length - 1;
    const width = this.sensor.strips * this.sensor.layers[0].pitch_mm;
    const c = Math.min(Math.max(((this.sensor.closed ? (x % width + width) % width : x) / width) * columns, 0), columns - 1e-9);
    const i = Math.floor(c), long = lengths[i] + (c - i) * (lengths[i + 1] - lengths[i]);
    const r = Math.min(Math.max((y / long) * rows, 0), rows - 1e-9), j = Math.floor(r);
    const near = mix(points[i][j], points[i][j + 1], r - j), far = mix(points[i + 1][j], points[i + 1][j + 1], r - j);
    const normal = cross(minus(far, near), minus(points[i][j + 1], points[i][j]));
    return [mix(near, far, c - i), normal.map((v) => outward * v)];
  }

  // An outline in strip coordinates as places in space, close enough to lie on the skin.
  laid(ring, closed = true) {
    const fine = 0.25 * this.sensor.layers[0].pitch_mm;
    return ring.flatMap((p, i) => {
      const q = ring[(i + 1) % ring.length];
      if (i + 1 === ring.length && !closed) return [p];
      const n = Math.min(64, Math.ceil(Math.hypot(q[0] - p[0], q[1] - p[1]) / fine) || 1);
      return Array.from({ length: n }, (_, k) => mix(p, q, k / n));
    }).concat(closed ? [ring[0]] : []).map((p) => this.at(p));
  }

  draw(frame) {
    this.last = frame;
    if (!this.skin || !this.canvas.clientWidth) return;
    if (!this.turned) this.face(frame);
    const { canvas } = this, scale = devicePixelRatio, w = canvas.clientWidth, h = canvas.clientHeight;
    if (canvas.width !== Math.round(w * scale)) canvas.width = Math.round(w * scale);
    if (canvas.height !== Math.round(h * scale)) canvas.height = Math.round(h * scale);
    const pen = canvas.getContext("2d"), style = getComputedStyle(canvas), colour = (name) => style.getPropertyValue(`--${name}`);
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, w, h);
    const { azimuth, elevation } = this.view, zoom = (0.42 * Math.min(w, h)) / this.reach;
    const to = [Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation)];
    const right = [-Math.sin(azimuth), Math.cos(azimuth), 0], up = cross(to, right);
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const on = (p) => { const q = minus(p, this.centre); return [w / 2 + zoom * dot(q, right), h / 2 - zoom * dot(q, up)]; };
    const tiles = this.tiles.map((tile) => [dot(tile.middle, to), tile]).sort((a, b) => a[0] - b[0]);
    pen.fillStyle = pen.strokeStyle = colour("strip");
    for (const [, { corners, normal }] of tiles) {
      const facing = dot(normal, to);
      pen.globalAlpha = facing > 0 ? 0.55 + 0.45 * facing : 0.35;
      pen.beginPath();
      corners.map(on).forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.closePath();
      pen.fill();
      pen.stroke();
    }
    const line = (laid, name, width, dash = []) => {
      pen.strokeStyle = colour(name);
      pen.lineWidth = width;
      pen.setLineDash(dash);
      for (const front of [false, true]) {
        pen.globalAlpha = front ? 1 : 0.18;
        pen.beginPath();
        laid.forEach(([p, normal], i) => {
          const [x, y] = on(p);
          if (i && (!normal || dot(normal, to) > 0) === front) { pen.moveTo(...on(laid[i - 1][0])); pen.lineTo(x, y); }
        });
        pen.stroke();
      }
      pen.setLineDash([]);
    };
    const readings = Object.values(frame.readings)[0] || [];
    this.strips.forEach((strip, i) => (readings[i] === null ? line(strip, "line", 1) : line(strip, "soft", 2)));
    line(this.seam, "soft", 1.5, [2, 4]);
    for (const one of frame.truth || []) {
      for (const wire of one.lines || []) { pen.globalAlpha = 1; line(wire.map((p) => [p, null]), "truth", 1); }
      for (const ring of one.rings || []) line(this.laid(ring, false), "truth", 2, [3, 4]);
    }
    for (const one of frame.objects) if (one.vertices.length) line(this.laid(one.vertices), "shape", 2.5);
    pen.globalAlpha = 1;
  }

  // Look at what touches from beside, until the user turns the skin.
  face(frame) {
    const ring = (frame.truth || []).flatMap((o) => o.rings || [])[0] || frame.objects.map((o) => o.vertices).find((v) => v.length);
    if (!ring) return;
    const normal = this.at([0, 1].map((i) => ring.reduce((sum, p) => sum + p[i], 0) / ring.length))[1];
    this.view = { azimuth: Math.atan2(normal[1], normal[0]) + 0.5, elevation: Math.min(1.2, Math.max(0.25, Math.asin(normal[2] / Math.hypot(...normal)) + 0.1)) };
    this.turned = true;
  }
}
