// The rig's own part of the page: devices at work, regions drawn on the live picture, sessions started.
"use strict";
const corners = [], drawn = [];
let seenTask = "rest", liveKnown = {};

async function act(name, content) {
  const response = await fetch(`/api/${name}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content || {}) });
  const told = await response.json().catch(() => ({ error: response.statusText }));
  $("said").textContent = told.error || told.done || told.file || "";
  return response.ok ? told : null;
}
const task = (kind) => act("task", { kind, exposure_ms: Number($("exposure").value), gain_db: Number($("gain").value) });
for (const button of document.querySelectorAll("[data-task]")) button.onclick = () => task(button.dataset.task);
$("turn").onclick = () => act("turn", { angle_deg: Number($("angle").value) });
$("dark").onclick = () => act("dark");
$("proposed").onclick = () => { $("exposure").value = $("proposed").dataset.ms; if (seenTask !== "rest") task(seenTask); };

function showRig(state) {
  $("rig").hidden = !state.hands || state.right !== "act";
  if ($("rig").hidden) return;
  tellRig(state.rig);
  const names = state.sessions.join();
  if ($("session").dataset.names !== names) { $("session").dataset.names = names; $("session").replaceChildren(); for (const name of state.sessions) put($("session"), "option", name); }
}

// What the devices do and see, told with every picture: whoever turns the lens looks at the number.
function tellRig(rig) {
  seenTask = rig.task;
  for (const button of document.querySelectorAll("[data-task]")) button.setAttribute("aria-pressed", button.dataset.task === rig.task);
  const words = [rig.problem || (rig.task === "rest" ? "devices are closed" : `${rig.exposure_ms.toPrecision(4)} ms, brightest ${(100 * rig.brightest).toFixed(0)} % of the range, ${(100 * rig.clipped).toPrecision(2)} % saturated`)];
  if (rig.angle_deg !== null) words.push(`polarizer ${rig.angle_deg.toFixed(2)} deg`);
  if (rig.cycles_per_min !== null) words.push(`${rig.cycles_per_min.toFixed(1)} cycles a minute`);
  if (rig.task === "polarimetry") words.push(rig.dark_dn === null ? "no dark level taken: DoLP reads too low" : `dark level ${rig.dark_dn.toFixed(1)} DN`);
  const text = words.join("; ");
  if ($("rig-text").textContent !== text) $("rig-text").textContent = text;
  const isSeen = rig.task !== "rest" && rig.best_sharpness > 0;
  $("focus").hidden = !isSeen;
  if (isSeen) {
    $("sharpness").value = rig.sharpness / rig.best_sharpness;
    $("sharpness-now").textContent = (1e3 * rig.sharpness).toPrecision(4); $("sharpness-best").textContent = (1e3 * rig.best_sharpness).toPrecision(4);
    $("focus").dataset.sequence = rig.sequence;
  }
  $("proposed").hidden = rig.proposed_ms === null || rig.task === "rest";
  if (rig.proposed_ms !== null) { $("proposed").textContent = `take ${rig.proposed_ms.toPrecision(3)} ms`; $("proposed").dataset.ms = rig.proposed_ms.toPrecision(3); }
  $("live-maps").hidden = !rig.maps_sequence;
  $("outlines").dataset.width = rig.width; $("outlines").dataset.height = rig.height;
}

async function rigPictures(state) {
  if (!state.hands || state.right !== "act") return false;
  let isNew = false;
  for (const name of ["view", ...(state.rig.maps_sequence ? MAPS : [])]) {
    const canvas = $(name === "view" ? "view" : `live-${name}`);
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
let cursor = null;
const size = () => [Number($("outlines").dataset.width), Number($("outlines").dataset.height)];
$("view").onclick = (event) => {
  const box = $("view").getBoundingClientRect(), [width, height] = size();
  if (width) corners.push([((event.clientX - box.left) / box.width) * width - 0.5, ((event.clientY - box.top) / box.height) * height - 0.5].map((v) => Math.round(v * 10) / 10));
  outline();
};
$("view").onkeydown = (event) => {
  const [width, height] = size(), step = event.shiftKey ? 1 : Math.max(1, Math.round(width / 40));
  const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }, move = moves[event.key];
  if (!width || (!move && event.key !== "Enter")) return;
  event.preventDefault();
  const at = cursor || [Math.round(width / 2), Math.round(height / 2)];
  if (move) cursor = [Math.min(width - 1, Math.max(0, at[0] + move[0])), Math.min(height - 1, Math.max(0, at[1] + move[1]))];
  else corners.push([...at]);
  outline();
};
$("view").onblur = () => { cursor = null; outline(); };
function outline() {
  const svg = $("outlines"), width = Number(svg.dataset.width), height = Number(svg.dataset.height), space = "http://www.w3.org/2000/svg";
  if (!width) return;
  svg.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`); svg.style.height = `${$("view").clientHeight}px`;
  svg.replaceChildren();
  const add = (tag, attributes, text) => { const node = document.createElementNS(space, tag); for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value); if (text) node.textContent = text; svg.append(node); };
  for (const region of drawn) { add("polygon", { points: region.polygon.map((p) => p.join()).join(" ") }); add("text", { x: region.polygon[0][0], y: region.polygon[0][1], "font-size": height / 24 }, region.name); }
  if (corners.length) add("polyline", { points: corners.map((p) => p.join()).join(" ") });
  for (const [cx, cy] of corners) add("circle", { cx, cy, r: height / 120 });
  if (cursor) add("path", { d: `M${cursor[0] - width / 30} ${cursor[1]}h${width / 15}M${cursor[0]} ${cursor[1] - width / 30}v${width / 15}` });
}
$("region-add").onclick = () => {
  const name = $("region-name").value.trim();
  if (corners.length < 3 || !name) { $("said").textContent = "touch three corners at least, and give a name"; return; }
  drawn.push({ name, polygon: corners.splice(0) }); $("region-name").value = ""; outline();
};
$("region-undo").onclick = () => { if (corners.length) corners.pop(); else drawn.pop(); outline(); };
$("region-save").onclick = () => act("regions", { regions: drawn });

$("plan").onclick = async () => { const told = await act("plan", { session: $("session").value }); $("plan-text").textContent = told ? told.plan : ""; $("start").disabled = !told; };
$("session").onchange = () => { $("start").disabled = true; $("plan-text").textContent = ""; };
$("start").onclick = async () => {
  $("start").disabled = true;
  const told = await act("start", { session: $("session").value });
  if (told) { $("said").textContent = `started: ${told.run}`; const wait = setInterval(() => { if (newest && newest.runs && newest.runs.some((row) => row.run === told.run)) { clearInterval(wait); go(told.run); } }, 500); }
};
