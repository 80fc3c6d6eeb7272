// The page: what comes in is kept, and the newest is drawn when the screen is ready.

import { draw as drawChart } from "./chart.js";
import { connect } from "./link.js";
import { Objects } from "./objects.js";
import { Solids } from "./solids.js";
import { Space } from "./space.js";
import { Surface } from "./surface.js";
import { Tracks } from "./tracks.js";

const get = (id) => document.getElementById(id);
const surface = new Surface(get("surface")), space = new Space(get("space")), tracks = new Tracks(get("tracks"));
let sensor = null, control = false, play = false, paused = false, frame = null, waiting = 0, drawing = false, lastMessage = 0, session = "", refusedAt = 0;
const FIELDS = ["construction", "strips", "noise", "hz", "method"], force = {}, reasons = {}; // what is in force, and why another was refused, by field
const drawn = { count: 0, times: [], frame: null };
window.tacstrip = drawn; // for the tests

const line = (state, text) => Object.assign(get("line"), { textContent: text }).setAttribute("data-state", state);
const link = connect(hear, line);
const place = (things) => { placed = things; if (!placing) sendPlaced(); };
const polygons = new Objects(surface, place), solids = new Solids(surface, place, showSolid);
let placed = null, placing = false, objects = polygons;

// At most one message about objects a screen refresh, the newest; without a connection it waits for one.
function sendPlaced() {
  placing = true;
  if (link.send({ do: "place", objects: placed })) placed = null;
  requestAnimationFrame(() => { if (placed) sendPlaced(); else placing = false; });
}

function hear(message) {
  if (message.kind === "frame") {
    waiting += 1;
    frame = message;
    if (!drawing) { drawing = true; requestAnimationFrame(show); }
  } else if (message.kind === "hello") {
    if (message.session !== session) { session = message.session; lastMessage = 0; } // another server: it counts anew
    control = message.control;
    about(message);
    line("on", control ? "connected" : "connected, look only"); }
  else if (message.kind === "state") state(message);
  else if (message.kind === "refused" && FIELDS.includes(message.field)) refuse(message.field, message.text);
  else if (message.kind === "notice") say(message.text);
  else if (message.kind === "refused" && performance.now() - refusedAt > 500) { refusedAt = performance.now(); say(message.text); }
}

function show() {
  drawing = false;
  for (; waiting > 0; waiting -= 1) link.send({ drawn: frame.number });
  if (paused || !sensor || Object.values(frame.readings)[0].length !== sensor.strips) return;
  surface.draw(frame);
  space.draw(frame);
  if (frame.truth) objects.take(frame.truth);
  drawChart(get("chart"), sensor, frame.readings);
  const now = performance.now();
  drawn.count += 1;
  drawn.frame = frame;
  drawn.times.push(now);
  while (drawn.times[0] < now - 1000) drawn.times.shift();
  tracks.take(frame.tracks, frame.searching);
  if (drawn.count % 12 === 1) { list(frame.objects); tracks.show(); }
}

function about(message) {
  if (JSON.stringify(message.sensor) !== JSON.stringify(sensor)) {
    sensor = message.sensor;
    surface.begin(sensor);
    space.begin(sensor);
    objects = sensor.presses ? solids : polygons;
    for (const layer of ["truths", "handles"]) surface.layers[layer].replaceChildren();
    document.querySelectorAll(".flat").forEach((e) => { e.hidden = Boolean(sensor.presses); });
    document.querySelectorAll(".solid").forEach((e) => { e.hidden = !sensor.presses; });
    if (sensor.presses) options(get("solid"), sensor.presses);
    objects.draw();
    const strips = sensor.layers.map((one) => one.strips).join(" + ");
    get("what").textContent = `${sensor.construction}, ${strips} strips, ${+surface.width.toFixed(1)} × ${+surface.length.toFixed(1)} mm`;
  }
  get("rigid").hidden = !message.tracking;
  play = Boolean(message.simulator);
  document.querySelectorAll(".play").forEach((e) => { e.hidden = !play; });
  surface.svg.classList.toggle("surface-look", !control);
  options(get("method"), message.methods, message.method);
  force.method = message.method;
  if (play) {
    options(get("construction"), message.constructions, sensor.construction);
    Object.assign(force, { construction: sensor.construction, strips: sensor.strips, noise: +(100 * message.simulator.noise).toFixed(3), hz: message.simulator.rate_hz });
    for (const id of ["strips", "noise", "hz"]) value(get(id), force[id]);
  }
  for (const id of FIELDS) if (reasons[id]) refuse(id, reasons[id]); // what is in force may be another by now
  document.querySelectorAll("form button, form select, form input, #record, #examine, #method").forEach((e) => { e.disabled = !control; });
}

// Say at a field why its number was refused; without a reason, that all is well.
function refuse(id, why) {
  const field = get(id), said = get(`${id}-refused`);
  const text = why && `${why}; ${force[id]} stays in force`;
  reasons[id] = why;
  if (said.textContent !== text) said.textContent = text; // read aloud once
  if (why) field.setAttribute("aria-invalid", "true");
  else field.removeAttribute("aria-invalid");
}

function options(select, names, chosen) {
  if (select.dataset.names !== String(names)) {
    select.dataset.names = String(names);
    select.replaceChildren(...names.map((name) => new Option(name, name)));
  }
  value(select, chosen);
}

function value(field, now) { if (document.activeElement !== field) field.value = now; }

// The fields of the solid that is chosen.
function showSolid(one) {
  for (const id of ["solid", "size", "depth"]) get(id).disabled = !one || !control;
  if (!one) return;
  value(get("solid"), one.solid);
  value(get("size"), one.size_mm);
  value(get("depth"), one.depth_mm);
  get("pressed").textContent = one.area_mm2 === undefined ? "" : `${one.area_mm2.toFixed(1)} mm², ${one.force_n.toFixed(2)} N by the skin's stiffness`;
}

function state(message) {
  about(message);
  const wire = message.wire;
  get("rate").textContent = message.rate_hz >= 100 ? message.rate_hz.toFixed(0) : message.rate_hz.toFixed(1);
  get("p50").textContent = `${message.latency_ms[0].toFixed(2)} ms`;
  get("p99").textContent = `${message.latency_ms[1].toFixed(2)} ms`;
  get("lost").textContent = wire.lost || 0;
  get("lost").title = Object.entries(wire).map(([name, count]) => `${name.replaceAll("_", " ")}: ${count}`).join(", ");
  get("skipped").textContent = message.late + message.unreadable;
  get("skipped").title = `recorded, but not recovered because the computer was behind: ${message.late}; no readings: ${message.unreadable}`;
  get("draws").textContent = paused ? "paused" : drawn.times.length;
  const silent = message.running && message.frames > 0 && message.rate_hz === 0;
  document.body.classList.toggle("no-scans", silent || !message.running);
  const also = message.command_records.map((path) => `; the command records ${path.split("/").pop()}`).join("");
  const well = (control ? "connected" : "connected, look only") + also;
  if (!message.running) line("off", "the stream has ended");
  else line(silent ? "wait" : "on", message.problem || (silent ? "no scans come" : well));
  const recording = message.recording;
  get("record").setAttribute("aria-pressed", Boolean(recording));
  get("record-text").textContent = recording ? `${recording.scans} scans, ${(recording.bytes / 1e6).toFixed(1)} MB` : "Record";
  for (const [number, text] of message.messages) if (number > lastMessage) { lastMessage = number; say(text); }
  health(message.health);
}

function say(text) {
  const item = document.createElement("li");
  item.textContent = text;
  get("said").prepend(item);
  while (get("said").childElementCount > 20) get("said").lastElementChild.remove();
}

function list(found) {
  const items = found.map((one) => {
    const item = document.createElement("li");
    const part = (kind, text, css) => { const e = document.createElement(kind); e.textContent = text; if (css) e.className = css; item.append(e); return e; };
    part("b", one.id);
    part("span", one.vertices.length ? `${one.outlined}, ${one.area.toFixed(0)} mm², at ${one.centroid[0]}, ${one.centroid[1]}` : "no shape");
    const sure = one.confidence === undefined ? "" : ` ${Math.round(100 * one.confidence)} %`;
    part("span", one.status + sure, "status").dataset.s = one.status;
    const others = one.alternatives || [];
    if (others.length) part("span", `dashed: or one of ${others.length} others, ${others.map((o) => `${Math.round(100 * o.weight)} %`).join(", ")}`, "advice");
    if (one.advice) part("span", one.advice, "advice");
    return item;
  });
  if (!items.length) {
    const none = document.createElement("li");
    none.className = "none";
    none.textContent = "nothing touches the sensor";
    items.push(none);
  }
  get("objects").replaceChildren(...items);
}

function health(state) {
  const row = get("strips-health"), strips = state.strips || Array(sensor.strips).fill("unchecked");
  get("examine").textContent = state.examining ? "Examining" : "Examine";
  const key = JSON.stringify([state.strips, state.findings, state.problem, sensor.strips]);
  if (row.dataset.key === key) return;
  row.dataset.key = key;
  row.replaceChildren(...strips.map((condition, i) => {
    const e = document.createElement("i");
    e.dataset.c = condition;
    e.title = `strip ${i + sensor.strip_base}: ${condition}${state.faults && state.faults[i].length ? `, ${state.faults[i].join(", ")}` : ""}`;
    return e;
  }));
  const count = (name) => strips.filter((c) => c === name).length;
  const words = `${count("ok")} ok, ${count("degraded")} degraded, ${count("broken")} broken, ${count("unchecked")} not touched yet`;
  row.setAttribute("aria-label", words);
  const noise = state.sigma ? ` Noise: ${(100 * state.sigma).toFixed(2)} % of Vref.` : "";
  if (state.problem) get("health-text").textContent = state.problem;
  else if (state.strips) get("health-text").textContent = `${words}.${noise} ${state.findings.join("; ")}`;
}

function pause() {
  paused = !paused;
  get("pause").setAttribute("aria-pressed", paused);
  get("pause").textContent = paused ? "Go on" : "Pause";
}

function theme(name) {
  document.documentElement.dataset.theme = name;
  get("theme").textContent = name === "dark" ? "Light" : "Dark";
  try { localStorage.setItem("theme", name); } catch { /* storage may be forbidden; the choice lasts as long as the page */ }
}

let kept = null;
try { kept = localStorage.getItem("theme"); } catch { /* as above */ }
theme(kept || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));

const record = () => { if (!get("record").disabled) link.send({ do: get("record").getAttribute("aria-pressed") === "true" ? "stop recording" : "record" }); };
get("pause").onclick = pause;
get("record").onclick = record;
get("theme").onclick = () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
get("examine").onclick = () => link.send({ do: "examine" });
get("method").onchange = (event) => { refuse("method", ""); link.send({ do: "method", method: event.target.value, field: "method" }); };
get("add").onclick = () => objects.add();
get("corner").onclick = () => objects.addCorner();
get("left").onclick = () => objects.turn(Math.PI / 36);
get("right").onclick = () => objects.turn(-Math.PI / 36);
get("remove").onclick = () => objects.remove();
get("play").onsubmit = (event) => event.preventDefault();
const setting = (id, name, read) => {
  get(id).onchange = (event) => {
    refuse(id, "");
    const field = event.target;
    if (field.type === "number" && (field.validity.badInput || field.value === "")) refuse(id, "not a number");
    else link.send({ do: "set", settings: { [name]: read(field.value) }, field: id });
  };
};
for (const [id, name] of [["solid", "solid"], ["size", "size_mm"], ["depth", "depth_mm"]]) {
  get(id).onchange = (event) => solids.set({ [name]: id === "solid" ? event.target.value : event.target.valueAsNumber });
}
setting("construction", "construction", String);
setting("strips", "strips", Number);
setting("noise", "noise", (text) => Number(text) / 100);
setting("hz", "rate_hz", Number);
document.addEventListener("keydown", (event) => {
  if (event.target.matches("input, select") || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "p") pause();
  if (event.key === "r") record();
});
