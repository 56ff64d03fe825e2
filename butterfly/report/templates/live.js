const live = JSON.parse(document.getElementById("live-data").textContent);
const at = (name) => document.getElementById(`live-${name}`);
const still = matchMedia("(prefers-reduced-motion: reduce)");
const STEPS = 100;  // of a slider, from the estimate to either end
const STILL_FRAME = 0.5;  // s between pictures where motion is to be reduced
const SWING = 0.6;  // rad, to which small swings can be magnified
const signed = new Intl.NumberFormat("en", {signDisplay: "exceptZero", maximumSignificantDigits: 3});
const view = {log: null, simulated: null, fit: NaN, from: 0, to: 1, instant: 0, playing: false, before: 0};

async function opened(number) {
  const log = live.logs[number];
  if (!log.u) [log.u, log.q] = await Promise.all([unpacked(log.commands), unpacked(log.measured)]);
  return log;
}

// ---- sliders

function reachOf(slider) {
  const near = live.intervals * slider.half;
  return at("range").value === "wide" ? Math.max(near, live.share * Math.abs(slider.value)) : near;
}
function decimals({half}) { return Math.min(Math.max(2 - Math.floor(Math.log10(half)), 0), 12); }
function textOf(slider, value) {
  const digits = decimals(slider), shown = Math.max(Math.min(digits + Math.floor(Math.log10(Math.abs(value) || 1)), 7), 2);
  return (value && Math.abs(value) < 1e-4 ? value.toExponential(shown) : value.toFixed(digits)).replace(/^-/, "−");
}
function valueOf(slider) {
  const place = Number(at(slider.name).value), value = slider.value + place / STEPS * reachOf(slider);
  return slider.least === null ? value : Math.max(value, slider.least);
}
function moves() {
  return Object.fromEntries(live.sliders.map((slider) => [slider.name, Number(at(slider.name).value) ? valueOf(slider) - slider.value : 0]));
}
function label(slider) {
  const input = at(slider.name), value = valueOf(slider), unit = slider.unit === "–" ? "" : ` ${slider.unit}`;
  const share = slider.value ? `, ${signed.format(100 * (value / slider.value - 1))} %` : "", text = textOf(slider, value);
  at(`${slider.name}-value`).textContent = text;
  input.setAttribute("aria-valuetext", Number(input.value) ? `${text}${unit}${share}` : `${text}${unit}, as identified`);
}
function range(slider) {
  const input = at(slider.name), reach = reachOf(slider);
  input.max = STEPS;
  input.min = slider.least === null ? -STEPS : Math.max(-STEPS, -Math.ceil(STEPS * (slider.value - slider.least) / reach));
}

// ---- pictures

const colours = () => {
  const css = getComputedStyle(document.documentElement), of = (name) => css.getPropertyValue(name).trim();
  return {ink: of("--ink"), faint: of("--faint"), rule: of("--rule"), measured: of("--accent"), simulated: of("--second")};
};
function cleared(canvas) {
  const scale = devicePixelRatio || 1, {clientWidth: width, clientHeight: height} = canvas;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) [canvas.width, canvas.height] = [Math.round(width * scale), Math.round(height * scale)];
  const to = canvas.getContext("2d");
  to.setTransform(scale, 0, 0, scale, 0, 0);
  to.clearRect(0, 0, width, height);
  to.font = "12px system-ui, sans-serif";
  return {to, width, height};
}
function ticks(least, most, count) {
  const rough = (most - least) / count || 1, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= 0.75 * rough);
  const digits = Math.max(-Math.floor(Math.log10(step) + 1e-9), 0);
  return Array.from({length: Math.floor(most / step + 1e-9) - Math.ceil(least / step - 1e-9) + 1}, (_, k) => {
    const value = (Math.ceil(least / step - 1e-9) + k) * step;
    return [value, (Math.abs(value) < step / 2 ? 0 : value).toFixed(digits).replace("-", "−")];
  });
}
function extremes(values, begin, end) {
  let low = Infinity, high = -Infinity;
  for (let k = begin; k < end; k++) {
    if (values[k] < low) low = values[k];
    if (values[k] > high) high = values[k];
  }
  return [low, high];
}
function panel({to, colour, left, right, top, bottom, title, curves, across}) {
  const {from, to: until, log: {step}} = view, begin = Math.floor(from / step), end = Math.min(Math.ceil(until / step) + 1, curves[0].values.length);
  const every = Math.max(Math.floor((end - begin) / (right - left)), 1);  // samples of a pixel
  let [least, most] = [Infinity, -Infinity];
  for (const {values, bounds = true} of curves) {
    const [low, high] = bounds ? extremes(values, begin, end) : [least, most];
    [least, most] = [Math.min(least, low), Math.max(most, high)];
  }
  if (!(least < most)) [least, most] = Number.isFinite(least) ? [least - 1e-6, most + 1e-6] : [-1, 1];
  const margin = 0.06 * (most - least), x = (t) => left + (t - from) / (until - from) * (right - left);
  [least, most] = [least - margin, most + margin];
  const y = (value) => bottom - (value - least) / (most - least) * (bottom - top);
  Object.assign(to, {lineWidth: 1, strokeStyle: colour.rule, fillStyle: colour.faint, textAlign: "right", textBaseline: "middle"});
  for (const [value, text] of ticks(least, most, Math.max((bottom - top) / 24, 1.5))) {
    to.beginPath(); to.moveTo(left, y(value)); to.lineTo(right, y(value)); to.stroke();
    to.fillText(text, left - 6, y(value));
  }
  to.textAlign = "center"; to.textBaseline = "top";
  for (const [value, text] of ticks(from, until, Math.max((right - left) / 90, 2))) {
    to.beginPath(); to.moveTo(x(value), top); to.lineTo(x(value), bottom); to.stroke();
    if (across) to.fillText(text, x(value), bottom + 5);
  }
  Object.assign(to, {textAlign: "left", textBaseline: "bottom", fillStyle: colour.ink});
  to.fillText(title, left, top - 4);
  to.save(); to.beginPath(); to.rect(left, top, right - left, bottom - top); to.clip();
  for (const {values, stroke, width = 1.5} of curves) {
    to.beginPath();
    Object.assign(to, {strokeStyle: stroke, lineWidth: width, lineJoin: "round"});
    for (let k = begin; k < end; k += every) {
      const [low, high] = extremes(values, k, Math.min(k + every, end));
      to.lineTo(x(k * step), y(low));
      if (high > low) to.lineTo(x(k * step), y(high));
    }
    to.stroke();
  }
  Object.assign(to, {strokeStyle: colour.ink, lineWidth: 1});
  to.beginPath(); to.moveTo(x(view.instant), top); to.lineTo(x(view.instant), bottom); to.stroke();
  to.restore();
}
function plot() {
  const {log, simulated: model} = view, {to, width, height} = cleared(at("plot")), colour = colours();
  const residual = log.q.map((each, k) => each - model[k]), left = 58, right = width - 10, split = 0.6 * height;
  const what = log.integrated ? "velocity" : live.shape === "slide" ? "position" : "angle";
  const common = {to, colour, left, right};
  panel({...common, top: 20, bottom: split, title: `${what} in ${log.unit}`, curves: [
    {values: model, stroke: colour.simulated, width: 6, bounds: false}, {values: log.q, stroke: colour.measured}]});
  panel({...common, top: split + 26, bottom: height - 36, across: true, title: `residual (measured − simulated) in ${log.unit}`, curves: [{values: residual, stroke: colour.ink, width: 1}]});
  Object.assign(to, {textAlign: "center", textBaseline: "bottom", fillStyle: colour.faint});
  to.fillText("time from the start of the log in s", (left + right) / 2, height - 2);
  at("plot").setAttribute("aria-label", `${log.label}: measured and simulated ${what}, residual below; FIT ${view.fit.toFixed(2)} %.`);
}
function shapeOf(to, angle, size, look) {
  to.save();
  Object.assign(to, {lineWidth: look.width, strokeStyle: look.stroke, fillStyle: look.fill});
  to.setLineDash(look.dash);
  to.beginPath();
  if (live.shape === "slide") to.rect(angle * size - 26, -18, 52, 36);
  else {
    to.rotate(-angle);
    if (live.shape === "butterfly") {
      for (let k = 0; k < 120; k++) {  // the hand's own outline, r = 0.1095 - 0.0405 cos 2 phi in m
        const phi = k * Math.PI / 60, r = size * (0.1095 - 0.0405 * Math.cos(2 * phi)) / 0.15;
        to.lineTo(r * Math.cos(phi), r * Math.sin(phi));
      }
      to.closePath();
    } else to.roundRect(-8, -14, 16, size + 8, 8);
  }
  to.globalAlpha = look.alpha; to.fill();
  to.globalAlpha = 1; to.stroke();
  if (view.log.added.mass && live.shape !== "slide") {
    to.beginPath();
    to.arc(0, size * Math.min(view.log.added.arm / (live.shape === "butterfly" ? 0.15 : view.log.added.arm), 1), 9, 0, 2 * Math.PI);
    to.stroke();
  }
  to.restore();
}
function hand() {
  const {log, simulated: model} = view, {to, width, height} = cleared(at("hand")), colour = colours();
  const k = Math.min(Math.round(view.instant / log.step), log.q.length - 1), zero = log.zero, times = at("magnify").checked ? log.times : 1;
  const [one, other] = [log.position[k], log.integrated ? NaN : model[k] - zero], slide = live.shape === "slide";
  const size = slide ? 0.4 * width / log.reach : live.shape === "butterfly" ? 0.42 * height : 0.7 * height;
  to.translate(width / 2, live.shape === "bar" ? 0.15 * height : height / 2);
  Object.assign(to, {strokeStyle: colour.rule, lineWidth: 1});
  to.beginPath();
  if (slide) { to.moveTo(-width / 2, 19); to.lineTo(width / 2, 19); } else { to.moveTo(0, 0); to.lineTo(0, size * 1.08); }
  to.stroke();
  shapeOf(to, one * times, size, {stroke: colour.measured, fill: colour.measured, alpha: 0.25, width: 2, dash: []});
  if (Number.isFinite(other)) shapeOf(to, other * times, size, {stroke: colour.simulated, fill: colour.simulated, alpha: 0.06, width: 2, dash: [5, 4]});
  if (!slide) { to.beginPath(); to.arc(0, 0, 4, 0, 2 * Math.PI); to.fillStyle = colour.ink; to.fill(); }
  const text = `${view.instant.toFixed(2)} s`, share = (view.instant - view.from) / (view.to - view.from);
  at("clock").textContent = text;
  at("scrub").value = Math.round(1000 * share);
  at("scrub").setAttribute("aria-valuetext", text);
}
function draw() { plot(); hand(); }

// ---- what is chosen

function simulateAgain() {
  const {log} = view;
  view.simulated = simulated(log, moves());
  const {fit, rms} = fitOf(log.q, view.simulated);
  view.fit = fit;
  at("fit").textContent = Number.isFinite(fit) ? `${fit > -1000 ? fit.toFixed(2) : "less than −1000"} %` : "none: the simulation diverges";
  at("identified").textContent = `with the identified values ${log.own.toFixed(2)} %, on the recorded samples ${log.raw.toFixed(2)} %`;
  at("residual").textContent = Number.isFinite(rms) ? `rms residual ${rms.toPrecision(3)} ${log.unit}` : "";
  live.sliders.forEach(label);
  draw();
}
let asked = 0;
function soon(what) { cancelAnimationFrame(asked); asked = requestAnimationFrame(what); }
function frameWindow() {
  const {log} = view, span = log.step * (log.q.length - 1);
  [view.from, view.to] = at("window").value === "whole" ? [0, span] : [span - log.shown, span];
  view.instant = view.from;
  draw();
}
async function choose(number) {
  const log = await opened(number);
  log.own ??= fitOf(log.q, simulated(log, {})).fit;
  if (!log.position) {  // of a log of velocities, what they add up to
    let way = 0;
    log.position = log.integrated ? log.q.map((each) => (way += log.step * each)) : log.q.map((each) => each - log.zero);
    const mean = log.position.reduce((sum, each) => sum + each, 0) / log.position.length;
    log.reach = log.position.reduce((most, each) => Math.max(most, Math.abs(each)), 1e-9);
    const swing = log.position.reduce((most, each) => Math.max(most, Math.abs(each - mean)), 1e-9);
    log.times = live.shape === "slide" ? 1 : [1, 2, 5, 10, 20, 50, 100].findLast((each) => each * swing <= SWING) ?? 1;
  }
  view.log = log;
  at("magnify-label").hidden = log.times === 1;
  at("magnify-label").querySelector("span").textContent = `angles × ${log.times}`;
  at("window").options[0].textContent = log.periods ? "last five periods" : `last ${log.shown.toFixed(0)} s`;
  view.simulated = log.q;
  frameWindow();
  simulateAgain();
}
function play(on) {
  view.playing = on;
  view.before = 0;
  at("play").textContent = on ? "Pause" : "Play";
  at("play").setAttribute("aria-pressed", on);
  if (on) requestAnimationFrame(tick);
}
function tick(now) {
  if (!view.playing) return;
  const passed = view.before ? (now - view.before) / 1000 : 0;
  if (!view.before || !still.matches || passed >= STILL_FRAME) {
    view.before = now;
    view.instant += passed * Number(at("speed").value);
    if (view.instant > view.to) view.instant = view.from + (view.instant - view.to) % (view.to - view.from);
    draw();
  }
  requestAnimationFrame(tick);
}
for (const slider of live.sliders) at(slider.name).addEventListener("input", () => soon(simulateAgain));
at("range").addEventListener("change", () => {
  for (const slider of live.sliders) { at(slider.name).value = 0; range(slider); }
  simulateAgain();
});
at("reset").addEventListener("click", () => {
  for (const slider of live.sliders) at(slider.name).value = 0;
  simulateAgain();
});
at("log").addEventListener("change", () => choose(Number(at("log").value)));
at("window").addEventListener("change", frameWindow);
at("play").addEventListener("click", () => play(!view.playing));
at("magnify").addEventListener("change", hand);
at("scrub").addEventListener("input", () => {
  play(false);
  view.instant = view.from + (view.to - view.from) * Number(at("scrub").value) / 1000;
  draw();
});
live.sliders.forEach(range);
setTimeout(() => choose(Number(at("log").value)).then(() => {  // after the first paint
  at("waiting").remove();
  document.getElementById("live").hidden = false;
  draw();
  new ResizeObserver(() => soon(draw)).observe(at("plot"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
}).catch((error) => { at("waiting").textContent = `No simulation: this browser cannot run it (${error.message}).`; }));
