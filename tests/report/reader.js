// A reader of the page "Move it and watch": what is done, and what is then seen.
(async () => {
  const open = document.body.appendChild(document.createElement("iframe"));
  open.contentDocument.open();  // the page goes on loading until the reader is done
  const at = (name) => document.getElementById(`live-${name}`);
  const wait = (time) => new Promise((done) => setTimeout(done, time));
  const frame = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const seen = {errors: window.errors, requests: []}, say = (name) => Object.assign(seen, {[name]: {
    fit: at("fit").textContent, identified: at("identified").textContent, residual: at("residual").textContent,
    clock: at("clock").textContent, plot: at("plot").getAttribute("aria-label"),
    pictures: [at("plot").toDataURL(), at("hand").toDataURL()]}});
  const put = async (name, value, kind) => {
    at(name).value = value;
    at(name).dispatchEvent(new Event(kind, {bubbles: true}));
    await frame();
  };
  const controls = () => [...document.querySelectorAll("#live input[type=range]")].map((each) => ({
    id: each.id, name: each.getAttribute("aria-label"), text: each.getAttribute("aria-valuetext"), min: each.min, max: each.max}));
  try {
    for (let k = 0; k < 50 && document.getElementById("live").hidden; k++) await wait(50);
    await frame();
    seen.controls = controls();
    say("first");
    await put("p1", 100, "input");
    seen.moved_controls = controls();
    say("moved");
    at("reset").click();
    await frame();
    say("reset");
    at("play").click();
    await wait(700);
    at("play").click();
    say("played");
    await put("scrub", 1000, "input");
    say("scrubbed");
    await put("window", "whole", "change");
    say("whole");
    await put("log", at("log").selectedIndex ? 0 : 1, "change");
    await wait(300);
    say("other");
    seen.requests = performance.getEntriesByType("resource").map((each) => each.name).filter((name) => !/^(data|blob):/.test(name));
  } catch (error) { seen.errors.push(String(error)); }
  const out = document.body.appendChild(document.createElement("pre"));
  out.id = "seen";
  out.textContent = JSON.stringify(seen);
  open.contentDocument.close();
})();
