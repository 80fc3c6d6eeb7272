// Objects over time: how well all scans together know each shape, and how that grew.

import { make } from "./surface.js";

const WIDE = 120, HIGH = 30, MOST = 400;

export class Tracks {
  constructor(list) {
    this.list = list;
    this.tracks = [];
    this.searching = 0;
    this.ways = new Map(); // by number: scans and deviation, as they grew
  }

  // Objects over time, and how many more are searched for; null: the computer was behind, and what is shown stays.
  take(known, searching) {
    this.searching = searching;
    const tracks = known || (searching ? [] : null);
    if (!tracks) return;
    const seen = new Map();
    for (const one of tracks) {
      let way = this.ways.get(one.id) || [];
      const last = way[way.length - 1];
      if (one.deviation_mm !== null && !(last && last[0] === one.scans)) {
        if (last && one.scans < last[0]) way = []; // another shape
        way = [...way, [one.scans, one.deviation_mm]];
        if (way.length > MOST) way = way.filter((_, i) => i % 2 === 0 || i === way.length - 1);
      }
      seen.set(one.id, way);
    }
    this.ways = seen;
    this.tracks = tracks;
  }

  show() {
    const items = this.tracks.map((one) => {
      const item = document.createElement("li");
      const part = (kind, text, css) => { const e = document.createElement(kind); e.textContent = text; if (css) e.className = css; item.append(e); return e; };
      part("b", one.id);
      part("span", one.deviation_mm === null ? "no shape" : `${one.status === "doubtful" ? "if the outline is right, " : ""}${one.corners} corners known to ${one.deviation_mm.toPrecision(2)} mm, from ${one.scans} scans`, "known");
      part("span", one.status, "status").dataset.s = one.status;
      const way = this.ways.get(one.id) || [];
      if (way.length > 1) item.append(curve(way));
      if (one.advice) part("span", one.advice, "advice");
      return item;
    });
    if (this.searching || !items.length) {
      const none = document.createElement("li");
      none.className = "none";
      none.textContent = this.searching ? "searching for a shape" : "no shape is known yet: slide or turn an object";
      items.push(none);
    }
    this.list.replaceChildren(...items);
  }
}

// The deviation by the number of scans, both by their logarithms; it falls as more is known.
function curve(way) {
  const x = way.map((p) => Math.log(p[0])), y = way.map((p) => Math.log(p[1]));
  const [left, right, low, high] = [Math.min(...x), Math.max(...x), Math.min(...y), Math.max(...y)];
  const at = (i) => `${((x[i] - left) / (right - left || 1)) * WIDE} ${HIGH - 2 - ((y[i] - low) / (high - low || 1)) * (HIGH - 4)}`;
  const svg = make("svg", { class: "known-curve", viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: "none", role: "img", "aria-label": `corners known to ${way[0][1].toPrecision(2)} mm after ${way[0][0]} scans, to ${way[way.length - 1][1].toPrecision(2)} after ${way[way.length - 1][0]}` });
  make("path", { d: `M${way.map((_, i) => at(i)).join("L")}` }, svg);
  return svg;
}
