// The page asks; the server answers one question at a time. A slow link gets fewer pictures, never late ones.
"use strict";
const $ = (id) => document.getElementById(id);
const STATE_MS = 1000, IDLE_MS = 250, LATE_MS = 3000, STALL_MS = 10000, LIST_MS = 5000;
const MAPS = ["s0", "dolp", "aolp"];
const INKS = ["#0b6fd6", "#d1495b", "#2e933c", "#8d5fd3", "#d98200", "#00838f", "#7a5200", "#5f6b73"];
let socket = null, run = new URLSearchParams(location.search).get("run") || "", selected = null, isChosen = false, known = {}, lastHeard = 0, newest = null, plots = {}, waiting = null, tries = 0, liveKnown = {};

// The look: as the device wants it, until a person chooses.
const wanted = () => localStorage.getItem("look") || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
const dress = () => { document.documentElement.dataset.look = wanted(); };
dress();
$("look").onclick = () => { localStorage.setItem("look", wanted() === "dark" ? "light" : "dark"); dress(); plots = {}; if (newest) show(newest); };

// Times by both clocks, of 24 hours; where this place keeps UTC, once. Today's date is left out.
const two = (n) => String(n).padStart(2, "0");
const here = (at) => `${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}`;
const utc = (text) => { const at = new Date(text), isToday = text && text.slice(0, 10) === new Date().toISOString().slice(0, 10); return text ? `${text.slice(isToday ? 11 : 0, 19).replace("T", " ")} UTC${isNaN(at) || !at.getTimezoneOffset() ? "" : ` (${here(at)} here)`}` : ""; };
const percent = (share) => { const p = 100 * share; return `${p === 0 || p >= 99.95 ? p.toFixed(0) : p >= 10 ? p.toFixed(1) : p.toPrecision(2)} %`; };
const span = (s) => { const h = Math.floor(s / 3600), m = Math.floor(s / 60) % 60; return h ? `${h} h ${m} min` : m ? `${m} min ${Math.round(s % 60)} s` : `${Math.round(s)} s`; };
const put = (parent, tag, text, attributes = {}) => { const node = document.createElement(tag); if (text !== undefined && text !== null) node.textContent = text; for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value); parent.append(node); return node; };

let isOver = false; // what the page was for is done, and its server gone
function connect() {
  if (isOver) return;
  const own = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
  socket = own;
  own.binaryType = "arraybuffer";
  own.onopen = () => { tries = 0; known = {}; $("lost").classList.remove("again"); work(own); };
  own.onmessage = (event) => { lastHeard = Date.now(); if (!$("lost").classList.contains("again")) $("lost").hidden = true; if (waiting) { const asked = waiting; waiting = null; asked.resolve(event.data); } };
  own.onclose = () => lost(own);
  setTimeout(() => { if (own.readyState === WebSocket.CONNECTING) lost(own); }, STALL_MS);
}
// A network may swallow everything without an error of the browser: a missing answer is reported.
setInterval(() => {
  const since = waiting ? Date.now() - waiting.asked : 0;
  if (since > LATE_MS) tellLost();
  if (since > STALL_MS && socket) lost(socket);
}, 500);
function tellLost() {
  if (isOver) return;
  sayLost(lastHeard ? `Nothing heard since ${utc(new Date(lastHeard).toISOString())}; trying again. What is shown is old.` : "No connection; trying again.");
}
function sayLost(text, isAgain = false) { $("lost").textContent = text; $("lost").classList.toggle("again", isAgain); $("lost").hidden = false; }
// A server that is back after a restart is asked anew; one with new tokens does not know this page any more.
let began = 0;
function heardFrom(state) {
  if (began && state.began && began !== state.began) { sayLost("The server was restarted; connected again.", true); setTimeout(() => { if ($("lost").classList.contains("again")) $("lost").hidden = true; }, 8000); known = {}; liveKnown = {}; }
  began = state.began || began;
}
async function isShutOut() {
  const answer = await fetch("/api/state").catch(() => null);
  if (answer && answer.status === 401) { isOver = true; sayLost("The server has new tokens: open the address that rigctl printed."); }
}
function lost(own) {
  if (own !== socket) return;
  socket = null; own.onclose = own.onmessage = null; own.close();
  tellLost();
  document.body.dataset.link = "lost";
  if (waiting) { const asked = waiting; waiting = null; asked.reject(new Error("lost")); }
  isShutOut();
  setTimeout(connect, Math.min(1000 * 2 ** tries++, 5000));
}
const ask = (question) => new Promise((resolve, reject) => {
  waiting = { resolve, reject, asked: Date.now() };
  socket.send(JSON.stringify({ run, ...question }));
});
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// Curves are long: they are sent again where they have grown.
let curvesKey = "", lastCurves = null;
function withCurves(state) {
  if (state.curves_key === undefined) return state;
  if (state.curves_key === curvesKey && !state.curves) return { ...state, curves: lastCurves };
  curvesKey = state.curves_key; lastCurves = state.curves;
  return state;
}

async function work(own) {
  document.body.dataset.link = "up";
  let shown = 0;
  try {
    while (own === socket && own.readyState === WebSocket.OPEN) {
      if (document.hidden) { await pause(IDLE_MS); continue; }
      const each = newest && newest.runs && !newest.actions ? LIST_MS : STATE_MS;
      if (Date.now() - shown > each) { shown = Date.now(); newest = withCurves(JSON.parse(await ask({ want: "state", curves: curvesKey }))); heardFrom(newest); show(newest); }
      const isNew = newest.runs ? await rigPictures(newest) : await pictures();
      if (!isNew) await pause(IDLE_MS);
    }
  } catch (error) { lost(own); }
}

async function pictures() {
  let isNew = false;
  const names = [selected, ...(newest.maps_of ? MAPS : [])].filter(Boolean);
  for (const name of names) {
    const top = Number($("dolp-top").value), key = MAPS.includes(name) ? `${name} ${top}` : name;
    const canvas = $(MAPS.includes(name) ? name : "frame");
    const answer = await ask({ want: "picture", name, after: canvas.dataset.key === key ? known[key] : null, dolp_top: top });
    const length = new DataView(answer).getUint32(0), head = JSON.parse(new TextDecoder().decode(new Uint8Array(answer, 4, length)));
    if (head.error) { $("frame-text").textContent = head.error; continue; }
    if (answer.byteLength === 4 + length) continue;
    const bitmap = await createImageBitmap(new Blob([new Uint8Array(answer, 4 + length)], { type: "image/jpeg" }));
    canvas.width = bitmap.width; canvas.height = bitmap.height;
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    known[key] = head.sequence; canvas.dataset.key = key; canvas.dataset.sequence = head.sequence;
    if (head.histogram && head.histogram.length) histogram(head);
    isNew = true;
  }
  return isNew;
}

function show(state) {
  $("version").textContent = state.rigctl || "";
  if (state.error) { $("advice").textContent = state.error; $("advice").hidden = false; return; }
  $("list").hidden = !state.runs; $("one").hidden = Boolean(state.runs);
  $("back").hidden = !run;
  if (state.runs) { list(state); return showRig(state); }
  document.title = `${state.run}: ${state.state}`;
  $("run").textContent = state.session ? `${state.run} (${state.session})` : state.run;
  const since = ["stale", "interrupted", "finished", "stopped", "holding", "waiting"].includes(state.state) && state.since_utc ? ` since ${utc(state.since_utc)}` : "";
  $("state").textContent = state.state + since; $("state").className = `pill ${state.state}`;
  $("simulated").hidden = !state.is_simulated;
  const canAct = state.right === "act" && state.actions;
  $("advice").textContent = canAct ? state.advice.replace(/ Continue with rigctl resume .*/, " Press Continue.") : state.advice; $("advice").hidden = !state.advice;
  facts(state); angles(state.newest); controls(state); curves(state.curves); calibrations(state.calibrations);
  for (const part of [document.querySelector("#maps .maps"), $("dolp-top").parentNode]) part.hidden = !state.maps_of;
  $("maps-of").textContent = state.maps_of ? `of the last cycle: ${state.maps_of}` : "No maps yet: they need a whole cycle.";
  $("events").replaceChildren(); for (const one of state.events) { const line = put($("events"), "li"); put(line, "small", `${utc(one.utc)} `); put(line, "b", one.event); line.append(` ${one.facts}`); }
  $("problems").replaceChildren(); for (const one of state.problems) put($("problems"), "li", one);
}

function facts(state) {
  const number = (value, digits, unit) => (value === null || value === undefined ? null : `${value.toFixed(digits)} ${unit}`);
  const pairs = [
    ["frames", state.frames_planned ? `${state.frames} of ${state.frames_planned}` : `${state.frames}`], ["last frame", state.step],
    ["time left", state.remaining_s === null ? null : span(Math.max(0, state.remaining_s))], ["ends", state.end_utc && utc(state.end_utc)],
    ["sun zenith", number(state.sun_zenith_deg, 1, "deg")], ["sun azimuth", number(state.sun_azimuth_deg, 1, "deg")],
    ["camera", number(state.camera_temperature_c, 1, "\u00b0C")], ["free disk", state.disk_free_mb ? number(state.disk_free_mb / 1000, 1, "GB") : null],
    ["sum rule", last(state.curves && state.curves.sum_rule, 4, "")], ["drift", last(state.curves && state.curves.drift_percent_per_min, 2, "%/min")],
  ];
  $("facts").replaceChildren();
  for (const [name, value] of pairs) if (value) { const box = put($("facts"), "div"); put(box, "dt", name); put(box, "dd", value); }
}
const last = (values, digits, unit) => { const found = (values || []).filter((v) => v !== null); return found.length ? `${found[found.length - 1].toFixed(digits)} ${unit}` : null; };

function calibrations(found) {
  const text = JSON.stringify(found);
  if ($("calibration-rows").dataset.text === text) return;
  $("calibration-rows").dataset.text = text;
  $("no-calibrations").hidden = found.length > 0; $("calibration-rows").parentNode.hidden = !found.length;
  $("calibration-rows").replaceChildren();
  const looks = { valid: "finished", doubtful: "waiting", "not valid": "interrupted" };
  for (const one of found) {
    const line = put($("calibration-rows"), "tr");
    put(line, "td", one.kind, { "data-of": "kind" }); put(line, "td", one.file, { "data-of": "file" }); put(line, "td", utc(one.made_utc), { "data-of": "made" });
    put(line, "td", one.valid_days === null ? "" : one.valid_days, { class: "number", "data-of": "valid for [days]" });
    const verdict = put(line, "td", null, { "data-of": "for this run" });
    put(verdict, "b", one.verdict, { class: looks[one.verdict] });
    if (one.words) verdict.append(`: ${one.words}`);
  }
  if (location.hash === "#calibrations" && !$("calibrations").dataset.seen) { $("calibrations").dataset.seen = "yes"; $("calibrations").scrollIntoView(); }
}

function angles(frames) {
  const names = frames.map((one) => one.name);
  if (!names.includes(selected) || !isChosen) selected = names[0] || null; // a scene, as soon as there is one
  if ($("angles").dataset.names !== names.join()) {
    $("angles").dataset.names = names.join();
    $("angles").replaceChildren();
    for (const name of names) put($("angles"), "button", /^-?[\d.]+$/.test(name) ? `${name}\u00b0` : name, { type: "button", role: "tab", "data-name": name }).onclick = () => { selected = name; isChosen = true; angles(frames); };
  }
  for (const button of $("angles").children) button.setAttribute("aria-selected", button.dataset.name === selected);
  const one = frames.find((frame) => frame.name === selected);
  $("frame").hidden = !one; $("frame-text").className = one ? "" : "empty";
  $("frame-text").textContent = one ? `${utc(one.utc)}, ${one.exposure_ms === null ? "exposure not known" : Number(one.exposure_ms.toPrecision(4)) + " ms"}, ${percent(one.clipped)} saturated (striped red); contrast stretched` : "No frame yet.";
}

function controls(state) {
  const going = ["live", "holding", "waiting", "stale"].includes(state.state);
  $("controls").hidden = state.right !== "act" || !state.actions || state.state === "finished";
  if ($("controls").dataset.state !== state.state) { $("controls").dataset.state = state.state; $("done").textContent = ""; }
  $("hold").disabled = !going || state.state === "holding"; $("stop").disabled = !going;
  $("resume").disabled = !["holding", "stopped", "interrupted"].includes(state.state);
  $("resume").classList.toggle("main", !$("resume").disabled); // the next step
}
for (const name of ["hold", "resume", "stop"]) {
  $(name).onclick = async () => {
    if (name === "stop") { // the others can be taken back by a touch
      $("question").textContent = "Stop the session after this frame?"; $("ask").showModal(); $("ask").querySelector("[value=no]").focus();
      await new Promise((resolve) => $("ask").addEventListener("close", resolve, { once: true }));
      if ($("ask").returnValue !== "yes") return;
    }
    const response = await fetch(`/api/${name}?run=${encodeURIComponent(run)}`, { method: "POST" });
    $("done").textContent = response.ok ? { hold: "It holds after this frame.", resume: "It continues.", stop: "It stops after this frame." }[name] : `${name}: ${(await response.text()).slice(0, 200)}`;
  };
}

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const clock = (_, splits) => splits.map((t) => new Date(t * 1e3).toISOString().slice(11, splits.length > 1 && splits[1] - splits[0] < 1 ? 21 : 19));
const digits = (_, splits) => { const step = splits.length > 1 ? Math.abs(splits[1] - splits[0]) : 1, n = Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(step || 1)))); return splits.map((v) => v.toFixed(n)); };
const axes = (x, y, isTime) => [x, y].map((label, i) => ({ label, values: isTime && !i ? clock : digits, space: i ? 30 : 80, stroke: style("--ink"), grid: { stroke: style("--line"), width: 0.5 }, ticks: { stroke: style("--line") }, size: i ? 78 : 46 }));
function draw(id, title, xLabel, yLabel, series, data, bands = [], isTime = false, scales = {}, height = 200) {
  const box = $(id), width = Math.max(280, Math.min(box.clientWidth || 700, 900)), key = JSON.stringify([title, xLabel, yLabel, width, series.map((s) => s.label)]);
  if (plots[id] && plots[id].key === key) { plots[id].plot.setData(data); return; }
  box.replaceChildren();
  if (!data[0].length) return;
  const plot = new uPlot({ ...(title ? { title } : {}), width, height, scales: { x: { time: isTime }, ...scales }, axes: axes(xLabel, yLabel, isTime), series: [{ label: xLabel }, ...series], legend: { live: false, show: series.length > 1 || isTime }, cursor: { show: false }, bands, tzDate: (ts) => uPlot.tzDate(new Date(ts * 1e3), "Etc/UTC") }, data, box);
  plots[id] = { key, plot };
}
function histogram(head, id = "histogram") {
  const counts = head.histogram.map((n) => Math.log10(n + 1));
  draw(id, null, "counts [share of the range]", "log pixels", [{ label: "pixels", stroke: style("--ink"), fill: style("--line"), points: { show: false }, paths: uPlot.paths.stepped({ align: 1 }) }], [counts.map((_, i) => i / counts.length), counts], [], false, {}, 140);
}
function curves(found) {
  if (!found) return;
  $("curves").hidden = !found.time_s.length && !found.left_out;
  $("read").textContent = found.frames_read < found.frames_there ? `(${found.frames_read} of ${found.frames_there} frames read)` : "";
  $("left-out").textContent = found.left_out ? `Excluded frames are left out of curves and maps: ${found.left_out}` : "";
  const bySun = $("against").value === "sun" && found.sun_zenith_deg.some((z) => z !== null);
  const x = bySun ? found.sun_zenith_deg : found.time_s, xLabel = bySun ? "zenith angle of the sun [deg]" : "time (UTC)";
  const order = x.map((_, i) => i).filter((i) => x[i] !== null).sort((a, b) => x[a] - x[b]);
  const at = (values) => order.map((i) => values[i]), xs = at(x);
  const points = () => ({ show: true, size: 6 }); // the library changes what it is given
  const lines = (pick) => found.regions.map((r, i) => ({ label: r.name, stroke: INKS[i % INKS.length], width: 2, points: points(), data: at(pick(r)) }));
  const plain = (id, title, y, pick, scales) => { const s = lines(pick); draw(id, title, xLabel, y, s, [xs, ...s.map((one) => one.data)], [], !bySun, scales); };
  const banded = (id, title, y, pick, std, scales) => {
    const series = [], data = [xs], bands = [];
    found.regions.forEach((r, i) => {
      const ink = INKS[i % INKS.length], values = at(pick(r)), errors = at(std(r)), edge = (sign) => values.map((v, k) => (v === null || errors[k] === null ? null : v + sign * errors[k]));
      series.push({ label: r.name, stroke: ink, width: 2, points: points() }); data.push(values);
      if (errors.some((s) => s !== null)) {
        for (const sign of [1, -1]) { series.push({ label: `${r.name} ${sign} sigma`, stroke: ink + "55", width: 1, points: { show: false }, class: "band" }); data.push(edge(sign)); }
        bands.push({ series: [series.length - 1, series.length], fill: ink + "33" });
      }
    });
    draw(id, bands.length ? `${title}; band: one sigma` : title, xLabel, y, series, data, bands, !bySun, scales);
  };
  banded("plot-dolp", "DoLP of the regions' means", "DoLP", (r) => r.dolp, (r) => r.dolp_std);
  banded("plot-aolp", "AoLP of the regions' means", "AoLP [deg]", (r) => r.aolp_deg, (r) => r.aolp_std_deg, { y: { range: [0, 180] } });
  // In thousands, millions or billions, so that an axis has few digits.
  const most = found.regions.flatMap((r) => r.light_dn_per_s).reduce((top, v) => Math.max(top, v || 0), 0), thousands = most < 1e4 ? 0 : Math.min(3, Math.floor(Math.log10(most) / 3));
  plain("plot-light", "S0 of the regions' means", `S0 [${["", "10\u00b3 ", "10\u2076 ", "10\u2079 "][thousands]}DN/s]`, (r) => r.light_dn_per_s.map((v) => (v === null ? null : v / 1000 ** thousands)));
  draw("plot-sum", "Sum rule (I0 + I90) / (I45 + I135) of the picture", xLabel, "sum rule", [{ label: "sum rule", stroke: style("--ink"), width: 2, points: points() }], [xs, at(found.sum_rule)], [], !bySun);
}
$("against").onchange = () => { plots = {}; if (newest && newest.curves) curves(newest.curves); };
$("dolp-top").onchange = () => { $("top").textContent = $("dolp-top").value; };
$("back").onclick = (event) => { event.preventDefault(); go(""); };
window.onpopstate = () => location.reload();
window.onresize = () => { plots = {}; if (newest && newest.curves) curves(newest.curves); };
history.scrollRestoration = "manual"; // another state begins at its top
function go(name) { history.pushState(null, "", name ? `?run=${encodeURIComponent(name)}` : "?"); location.reload(); }

function list({ runs: rows, title, actions }) {
  $("run").textContent = title || (actions ? "Rig" : "Runs"); $("state").textContent = rows.length === 1 ? "1 run" : `${rows.length} runs`; $("state").className = "pill plain"; $("advice").hidden = true;
  $("state").hidden = Boolean(title); $("runs").hidden = Boolean(title) || !rows.length; $("no-runs").hidden = Boolean(title) || rows.length > 0;
  $("no-runs").textContent = actions ? "No runs yet. Choose a session and press Start." : "No runs yet. A run appears here as soon as rigctl acquire has begun it.";
  document.title = `rigctl: ${title || "runs"}`;
  const text = JSON.stringify(rows);
  if ($("rows").dataset.text === text) return;
  $("rows").dataset.text = text;
  const body = document.createDocumentFragment();
  for (const row of rows) {
    const line = put(body, "tr");
    const cell = put(line, "td");
    if (row.frames) put(cell, "img", null, { alt: "", loading: "lazy", src: `/api/frame/thumb?run=${encodeURIComponent(row.run)}` });
    const link = put(put(line, "td"), "a", row.run, { href: `?run=${encodeURIComponent(row.run)}` });
    link.onclick = (event) => { event.preventDefault(); go(row.run); };
    put(line, "td", row.state, { class: row.state, "data-of": "state" });
    put(line, "td", utc(row.begun_utc), { "data-of": "begun" });
    put(line, "td", row.frames, { class: "number", "data-of": "frames" });
    put(line, "td", row.sun_zenith_deg === null ? "" : row.sun_zenith_deg.toFixed(1), { class: "number", "data-of": "sun zenith [deg]" });
    put(line, "td", row.verdict, { "data-of": "verdict" });
    const pages = put(line, "td", null, { "data-of": "pages" });
    for (const name of row.pages) { put(pages, "a", name, { href: `/api/document/${encodeURIComponent(row.run)}/${encodeURIComponent(name)}`, target: "_blank", rel: "noopener" }); pages.append(" "); }
    if (row.frames) put(pages, "a", "calibrations", { href: `?run=${encodeURIComponent(row.run)}#calibrations` });
  }
  $("rows").replaceChildren(body);
}
connect();
