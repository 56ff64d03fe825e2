const OPTIONS = {responsive: true, displaylogo: false, showSendToCloud: false, plotlyServerURL: "",
  modeBarButtonsToRemove: ["select2d", "lasso2d"]};
const DARK = {"#0072B2": "#5aaee8", "#E69F00": "#f2b63c", "#009E73": "#35c99c", "#CC79A7": "#e59cc5", "#56B4E9": "#9bd6f7",
  "#D55E00": "#ff8f4a", "#F0E442": "#f5ec7a", "#888888": "#9aa5b0"};
const LIGHT = {"#F0E442": "#a89b00"};
const PRINTED = {ink: "#1b1f24", rule: "#d8dde2", width: 680, height: 640};
const dark = matchMedia("(prefers-color-scheme: dark)");
let printing = false;

function recoloured(value, colours) {
  if (typeof value === "string") return colours[value] ?? value;
  if (Array.isArray(value)) return ["object", "string"].includes(typeof value[0]) ? value.map(each => recoloured(each, colours)) : value;
  if (value === null || typeof value !== "object" || ArrayBuffer.isView(value)) return value;
  return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, recoloured(each, colours)]));
}
function themed({data, layout}) {
  const css = getComputedStyle(document.documentElement);
  const ink = printing ? PRINTED.ink : css.getPropertyValue("--ink").trim();
  const rule = printing ? PRINTED.rule : css.getPropertyValue("--rule").trim();
  const colours = dark.matches && !printing ? DARK : LIGHT;
  const narrow = innerWidth < 640 && !printing;
  const own = recoloured(layout, colours);
  const result = {xaxis: {}, yaxis: {}, ...own, template: {}, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: {color: ink, size: narrow ? 11 : 12}, margin: {l: narrow ? 48 : 70, r: narrow ? 18 : 45, t: 15, b: 50},
    modebar: {orientation: "v", bgcolor: "rgba(0,0,0,0)", color: rule, activecolor: ink},
    legend: {orientation: "h", y: 1.01, yanchor: "bottom"}, hoverlabel: {namelength: -1},
    dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom"};
  const height = own.height ?? 450, named = data.filter(trace => trace.name && trace.showlegend !== false).length;
  if (printing) Object.assign(result, {width: PRINTED.width, height: Math.min(height, PRINTED.height)});
  else { Object.assign(result, {autosize: true, height: height + (narrow ? 20 * named : 0)}); delete result.width; }
  if (narrow && own.annotations) result.annotations = own.annotations.map(note => note.name === "mark" ? {...note, textangle: -90, xshift: 0, yanchor: note.y > 0.9 ? "top" : note.y < 0.1 ? "bottom" : "middle"} : note);
  for (const key of Object.keys(result)) {
    if (/^[xy]axis/.test(key)) result[key] = {...result[key], gridcolor: rule, zerolinecolor: rule, linecolor: rule, automargin: true, exponentformat: "power", minexponent: 4};
  }
  return [data.map(trace => recoloured(trace, colours)), result, {...OPTIONS, displayModeBar: narrow || data.some(trace => trace.type === "heatmap") ? false : "hover"}];
}
function numbers({begin, quantum, steps, logarithmic}) {
  let whole = 0;
  const linear = Float64Array.from(steps, step => step === null ? NaN : begin + (whole += step) * quantum);
  return logarithmic ? linear.map(each => 10 ** each) : linear;
}
let whole = false;
function ofLog({data, layout, curves, stretches}, log) {
  const [begin, end] = (!whole && stretches[log]) || [-Infinity, Infinity];
  const drawn = curves[log].flatMap(group => {
    const [x, ...ys] = group.map(numbers);
    const seen = values => values.filter((_, k) => !(x[k] < begin || x[k] > end));
    return ys.map(y => ({x: seen(x), y: seen(y)}));
  });
  return {data: data.map((trace, k) => ({...trace, ...drawn[k]})), layout};
}
function drawChosen() {
  document.querySelectorAll(".chooser").forEach(each => { each.value = chosen; });
  document.querySelectorAll("tr.pick").forEach(row => row.setAttribute("aria-current", row.dataset.index == chosen));
  for (const place of document.querySelectorAll(".series")) Plotly.react(place, ...themed(ofLog(series[place.dataset.figure], chosen)));
}
function draw() {
  for (const place of document.querySelectorAll(".figure")) Plotly.react(place, ...themed(figures[place.dataset.figure]));
  drawChosen();
}
function choose(log, {show = false} = {}) {
  chosen = log;
  drawChosen();
  if (show) document.querySelector(".series")?.scrollIntoView({behavior: "smooth", block: "center"});
}
document.querySelectorAll(".chooser").forEach(each => each.addEventListener("change", () => choose(Number(each.value))));
document.querySelectorAll(".step").forEach(each => each.addEventListener("click", () => {
  const count = document.querySelector(".chooser").length;
  choose((chosen + Number(each.dataset.step) + count) % count);
}));
document.querySelectorAll(".whole").forEach(each => each.addEventListener("click", () => {
  whole = !whole;
  document.querySelectorAll(".whole").forEach(own => own.setAttribute("aria-pressed", whole));
  drawChosen();
}));
document.querySelectorAll("tr.pick").forEach(row => {
  const pick = () => choose(Number(row.dataset.index), {show: true});
  row.addEventListener("click", pick);
  row.addEventListener("keydown", event => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    pick();
  });
});
draw();
for (const place of document.querySelectorAll(".figure")) {
  place.on("plotly_click", event => {
    const log = event.points[0]?.customdata;
    if (Number.isInteger(log) && Object.keys(series).length) choose(log, {show: true});
  });
}
dark.addEventListener("change", draw);
addEventListener("beforeprint", () => {
  printing = true;
  document.querySelectorAll("details").forEach(each => { each.open = true; });
  draw();
});
addEventListener("afterprint", () => { printing = false; draw(); });
