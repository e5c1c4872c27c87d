// The rig's own part of the page: devices at work, regions drawn on the live picture, sessions started.
"use strict";
const corners = [], drawn = [], SETTINGS = ["exposure", "gain", "zoom"];
let seenTask = "rest";

async function act(name, content) {
  const response = await fetch(`/api/${name}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content || {}) });
  const answer = await response.json().catch(() => ({ error: response.statusText }));
  $("said").textContent = answer.error || (name === "task" ? "" : answer.done) || (answer.file ? `written: ${answer.file}` : "");
  return response.ok ? answer : null;
}
const task = (kind) => act("task", { kind, exposure_ms: Number($("exposure").value) || null, gain_db: Number($("gain").value), zoom: Number($("zoom").value) });
for (const name of SETTINGS) {
  $(name).oninput = () => { $(name).dataset.filled = "yes"; };
  $(name).onchange = () => { if (seenTask !== "rest") task(seenTask); };
}
for (const button of document.querySelectorAll("[data-task]")) button.onclick = () => task(button.dataset.task);
$("turn").onclick = () => act("turn", { angle_deg: Number($("angle").value) });
$("dark").onclick = () => act("dark");

function showRig(state) {
  $("rig").hidden = !state.actions || state.right !== "act";
  if ($("rig").hidden) return;
  for (const one of document.querySelectorAll("[data-act]")) one.hidden = !state.acts.includes(one.dataset.act);
  $("region-save").textContent = `Write ${state.regions_file}`;
  if (!$("regions").dataset.filled) { $("regions").dataset.filled = "yes"; drawn.push(...state.drawn); regions(); }
  tellRig(state.rig);
  const names = state.sessions.join();
  if ($("session").dataset.names !== names) { $("session").dataset.names = names; $("session").replaceChildren(); for (const name of state.sessions) put($("session"), "option", name); }
  $("no-sessions").hidden = names !== ""; $("start").disabled = $("plan").disabled = names === "";
}

// State of the devices, with every picture: a person who turns the lens looks at the sharpness.
function tellRig(rig) {
  seenTask = rig.task;
  // Settings that others began with, the first time that there are any.
  const settings = { exposure: rig.is_automatic ? "" : Number(rig.exposure_ms.toPrecision(6)), gain: rig.gain_db, zoom: rig.zoom };
  if (rig.task !== "rest") for (const name of SETTINGS) if (!$(name).dataset.filled) { $(name).dataset.filled = "yes"; $(name).value = settings[name]; }
  for (const button of document.querySelectorAll("[data-task]")) { const kind = button.dataset.task; button.setAttribute("aria-pressed", kind === rig.task && kind !== "rest"); button.disabled = kind === "rest" && kind === rig.task; button.classList.toggle("main", kind === "preview" && rig.task === "rest"); }
  const words = [rig.problem || (rig.task === "rest" ? "" : `${Number(rig.exposure_ms.toPrecision(4))} ms${rig.is_automatic ? " (automatic)" : ""}, brightest ${(100 * rig.brightest).toFixed(0)} % of the range, ${percent(rig.clipped)} saturated`)];
  if (rig.angle_deg !== null) words.push(`polarizer ${(Math.round(100 * rig.angle_deg) / 100 % 180).toFixed(2)} deg`);
  if (rig.cycles_per_min !== null) words.push(`${rig.cycles_per_min.toFixed(1)} cycles a minute`);
  if (rig.task === "polarimetry") words.push(rig.dark_dn === null ? "no dark level taken: DoLP reads too low" : `dark level ${rig.dark_dn.toFixed(1)} DN`);
  const text = words.filter(Boolean).join("; ");
  if ($("rig-text").textContent !== text) $("rig-text").textContent = text;
  const isSeen = rig.task !== "rest" && rig.best_sharpness > 0;
  $("focus").hidden = !isSeen;
  if (isSeen) {
    $("sharpness").value = rig.sharpness / rig.best_sharpness;
    $("sharpness-now").textContent = (1e3 * rig.sharpness).toPrecision(4); $("sharpness-best").textContent = (1e3 * rig.best_sharpness).toPrecision(4);
    $("focus").dataset.sequence = rig.sequence;
  }
  $("closed").hidden = rig.width > 0; $("view").parentNode.hidden = $("view-histogram").hidden = !rig.width;
  $("live-maps").hidden = !rig.maps_sequence;
  for (const name of ["left", "top", "width", "height"]) $("outlines").dataset[name] = rig[name];
  $("view").classList.toggle("pixels", rig.zoom > 1);
}

async function rigPictures(state) {
  if (!state.actions || state.right !== "act") return false;
  let isNew = false;
  for (const name of ["view", ...(state.rig.maps_sequence ? MAPS : [])]) {
    const canvas = $(name === "view" ? "view" : `live-${name}`);
    if (!canvas.offsetParent && name === "s0") continue; // a telephone has no room for it
    const answer = await ask({ want: "picture", of: "rig", name, after: liveKnown[name] || null });
    const length = new DataView(answer).getUint32(0), head = JSON.parse(new TextDecoder().decode(new Uint8Array(answer, 4, length)));
    if (head.rig) tellRig(head.rig);
    if (answer.byteLength === 4 + length) continue;
    const bitmap = await createImageBitmap(new Blob([new Uint8Array(answer, 4 + length)], { type: "image/jpeg" }));
    canvas.width = bitmap.width; canvas.height = bitmap.height;
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    canvas.dataset.sequence = head.sequence; liveKnown[name] = head.sequence; isNew = true;
    if (name === "view") { histogram(head, "view-histogram"); outline(); }
  }
  return isNew;
}

// Corners are in pixels of the camera: (0, 0) is the centre of the top left one. By keyboard: arrows move, Enter sets.
let cursor = null, hover = null, pressed = null;
const part = () => ["left", "top", "width", "height"].map((name) => Number($("outlines").dataset[name] || 0));
const canDraw = () => part()[2] > 0 && newest && newest.acts && newest.acts.includes("regions");
function place(event) {
  const box = $("view").getBoundingClientRect(), [left, top, width, height] = part();
  const at = (share, from, length) => Math.round((from + Math.min(1, Math.max(0, share)) * length - 0.5) * 10) / 10;
  return [at((event.clientX - box.left) / box.width, left, width), at((event.clientY - box.top) / box.height, top, height)];
}
$("view").onpointerdown = (event) => { pressed = canDraw() && event.pointerType === "mouse" ? { at: place(event), x: event.clientX, y: event.clientY } : null; };
$("view").onpointermove = (event) => { if (canDraw() && event.pointerType === "mouse") { hover = place(event); outline(); } };
$("view").onpointerleave = () => { hover = null; outline(); };
$("view").onclick = (event) => {
  if (!canDraw()) return;
  const isDragged = pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) > 5;
  if (isDragged) corners.splice(0, corners.length, pressed.at, place(event)); else corners.push(place(event));
  pressed = null;
  outline();
};
$("view").onkeydown = (event) => {
  const [left, top, width, height] = part(), step = event.shiftKey ? 1 : Math.max(1, Math.round(width / 40));
  const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }, move = moves[event.key];
  if (event.key === "Escape") { corners.length = 0; cursor = null; outline(); }
  if (!canDraw() || (!move && event.key !== "Enter")) return;
  event.preventDefault();
  const at = cursor || [left + Math.round(width / 2), top + Math.round(height / 2)];
  if (move) cursor = [Math.min(left + width - 1, Math.max(left, at[0] + move[0])), Math.min(top + height - 1, Math.max(top, at[1] + move[1]))];
  else corners.push([...at]);
  outline();
};
addEventListener("resize", () => outline());
$("view").onblur = () => { cursor = null; outline(); };

// Two corners make a rectangle of whole pixels, more a polygon.
function shapeOf(points) {
  if (points.length > 2) return { polygon: [...points] };
  const [from, to] = [0, 1].map((axis) => points.map((point) => Math.round(point[axis] + 0.5)).sort((a, b) => a - b)).reduce((xs, ys) => [[xs[0], ys[0]], [xs[1], ys[1]]]);
  return { rectangle: { x: from[0], y: from[1], width: to[0] - from[0], height: to[1] - from[1] } };
}
function cornersOf({ polygon, rectangle: r }) {
  if (polygon) return polygon;
  const [left, top, right, bottom] = [r.x - 0.5, r.y - 0.5, r.x + r.width - 0.5, r.y + r.height - 0.5];
  return [[left, top], [right, top], [right, bottom], [left, bottom]];
}
function outline() {
  const svg = $("outlines"), [left, top, width, height] = part(), space = "http://www.w3.org/2000/svg";
  if (!width) return;
  svg.setAttribute("viewBox", `${left - 0.5} ${top - 0.5} ${width} ${height}`); svg.style.height = `${$("view").clientHeight}px`;
  svg.replaceChildren();
  const add = (tag, attributes, text) => { const node = document.createElementNS(space, tag); for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value); if (text) node.textContent = text; svg.append(node); };
  const line = (tag, points) => add(tag, { points: points.map((p) => p.join()).join(" ") });
  for (const region of drawn) { const points = cornersOf(region); line("polygon", points); add("text", { x: points[0][0], y: points[0][1], "font-size": height / 24 }, region.name); }
  const dragged = pressed && hover ? [pressed.at, hover] : corners;
  if (dragged.length === 2) line("polygon", cornersOf(shapeOf(dragged))); else if (dragged.length) line("polyline", dragged);
  for (const [cx, cy] of dragged) add("circle", { cx, cy, r: height / 120 });
  if (cursor) add("path", { d: `M${cursor[0] - width / 30} ${cursor[1]}h${width / 15}M${cursor[0]} ${cursor[1] - width / 30}v${width / 15}` });
  const at = cursor || hover;
  $("where").textContent = at ? `x ${at[0].toFixed(1)}, y ${at[1].toFixed(1)} [pixel]` : "";
}
function regions() {
  $("regions").hidden = !drawn.length; $("region-rows").replaceChildren();
  drawn.forEach((region, k) => {
    const row = put($("region-rows"), "tr"), r = region.rectangle;
    put(row, "td", region.name, { "data-of": "region" });
    put(row, "td", r ? `${r.width} x ${r.height} pixels` : `${region.polygon.length} corners`, { "data-of": "shape" });
    put(row, "td", region.edge_px || 0, { "data-of": "border [pixel]" });
    put(put(row, "td"), "button", "remove", { type: "button", "aria-label": `remove ${region.name}` }).onclick = () => { drawn.splice(k, 1); regions(); };
  });
  $("region-name").value = `panel_${drawn.length + 1}`;
  outline();
}
$("region-add").onclick = () => {
  const name = $("region-name").value.trim(), shape = corners.length > 1 ? shapeOf(corners) : null, r = shape && shape.rectangle;
  if (!shape || !name || (r && !(r.width && r.height))) { $("said").textContent = "touch two opposite corners of a rectangle, or three corners at least, and give a name"; return; }
  drawn.push({ name, edge_px: Number($("region-edge").value), ...shape }); corners.length = 0; $("said").textContent = ""; regions();
};
$("region-undo").onclick = () => { if (corners.length) { corners.pop(); outline(); } else { drawn.pop(); regions(); } };
$("region-save").onclick = async () => {
  if (corners.length) { $("said").textContent = "add the region whose corners are set first, or take them back"; return; }
  const answer = await act("regions", { regions: drawn }).catch(() => null);
  $("said").scrollIntoView({ block: "nearest" });
  if (!answer) { if (!$("said").textContent) $("said").textContent = "no answer; nothing was written"; return; }
  if (newest.is_once) { isOver = true; $("lost").hidden = true; $("region-save").disabled = true; $("said").textContent = `sent: ${answer.file} is written. This page can be closed.`; }
};

$("plan").onclick = async () => { const answer = await act("plan", { session: $("session").value }); $("plan-text").textContent = answer ? answer.plan : ""; };
$("session").onchange = () => { $("plan-text").textContent = ""; };
$("start").onclick = async () => {
  $("start").disabled = true;
  const answer = await act("start", { session: $("session").value });
  $("start").disabled = false;
  if (answer) { $("said").textContent = `Started: ${answer.run}`; const wait = setInterval(() => { if (newest && newest.runs && newest.runs.some((row) => row.run === answer.run)) { clearInterval(wait); go(answer.run); } }, 500); }
};
