// The signatures over x, on a canvas.

const NAMES = { kh: "k_h", kl: "k_l", k: "k" };

export function draw(canvas, sensor, readings) {
  const box = canvas.getBoundingClientRect();
  const dots = window.devicePixelRatio || 1;
  const width = Math.round(box.width * dots), height = Math.round(box.height * dots);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const pen = canvas.getContext("2d");
  pen.setTransform(dots, 0, 0, dots, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  const css = getComputedStyle(document.documentElement);
  const colour = (name) => css.getPropertyValue(`--${name}`);
  const letters = 0.75 * parseFloat(css.fontSize);  // [px]
  const left = 2.2 * letters, bottom = 1.5 * letters, top = 0.6 * letters, right = 6;
  const w = box.width - left - right, h = box.height - top - bottom;
  pen.font = `${letters}px system-ui, sans-serif`;
  pen.lineWidth = 1;
  for (const value of [0, 0.25, 0.5, 0.75, 1]) {
    const y = top + (1 - value) * h;
    pen.strokeStyle = colour("line");
    pen.beginPath();
    pen.moveTo(left, y);
    pen.lineTo(left + w, y);
    pen.stroke();
    pen.fillStyle = colour("soft");
    if (value !== 0.25 && value !== 0.75) pen.fillText(String(value), 4, y + 0.35 * letters);
  }
  const [first, second] = sensor.layers, border = second ? first.strips : sensor.strips; // layer 1 begins there
  pen.fillText(second ? "layer 0" : "0", left, box.height - 0.35 * letters);
  const end = second ? "layer 1" : `${+(first.strips * first.pitch_mm).toFixed(1)} mm`;
  pen.fillText(end, left + w - pen.measureText(end).width, box.height - 0.35 * letters);
  let label = left + 0.5 * w - 2.7 * letters;
  for (const [name, values] of Object.entries(readings)) {
    pen.strokeStyle = pen.fillStyle = colour(name);
    pen.fillText(NAMES[name], label, box.height - 0.35 * letters);
    label += 3 * letters;
    pen.lineWidth = 1.8;
    pen.beginPath();
    let on = false;
    values.forEach((value, i) => {
      if (value === null) { on = false; return; }
      const x = left + ((i + 0.5) / values.length) * w, y = top + (1 - value) * h;
      if (on && i !== border) pen.lineTo(x, y); else pen.moveTo(x, y);
      on = true;
    });
    pen.stroke();
    if (values.length > 60) continue;
    values.forEach((value, i) => {
      if (value === null) return;
      pen.fillRect(left + ((i + 0.5) / values.length) * w - 2, top + (1 - value) * h - 2, 4, 4);
    });
  }
}
