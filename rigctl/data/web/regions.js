"use strict";
const canvas = document.getElementById("canvas"), pen = canvas.getContext("2d");
const element = id => document.getElementById(id);
const picture = new Image();
let regions = [], corners = [], from = null, to = null, scale = 1;

const shape = () => document.querySelector("input[name=shape]:checked").value;
// Pixel centres have whole coordinates: the top left corner of the picture is (-0.5, -0.5).
const place = event => {
  const box = canvas.getBoundingClientRect();
  const clip = (value, most) => Math.min(Math.max(value, 0), most);
  return [clip((event.clientX - box.left) / scale, picture.width) - 0.5,
          clip((event.clientY - box.top) / scale, picture.height) - 0.5];
};
const rectangle = (a, b) => {
  const left = Math.round(Math.min(a[0], b[0]) + 0.5), top = Math.round(Math.min(a[1], b[1]) + 0.5);
  const right = Math.round(Math.max(a[0], b[0]) + 0.5), bottom = Math.round(Math.max(a[1], b[1]) + 0.5);
  return { x: left, y: top, width: right - left, height: bottom - top };
};
const outline = region => region.polygon || (r => [
  [r.x - 0.5, r.y - 0.5], [r.x + r.width - 0.5, r.y - 0.5],
  [r.x + r.width - 0.5, r.y + r.height - 0.5], [r.x - 0.5, r.y + r.height - 0.5]])(region.rectangle);

function trace(points, closed) {
  pen.beginPath();
  points.forEach(([x, y], k) => pen[k ? "lineTo" : "moveTo"]((x + 0.5) * scale, (y + 0.5) * scale));
  if (closed) pen.closePath();
  for (const [colour, width] of [["#000", 4], ["#ffd000", 2]]) {
    pen.strokeStyle = colour; pen.lineWidth = width; pen.stroke();
  }
}
function draw() {
  pen.drawImage(picture, 0, 0, canvas.width, canvas.height);
  for (const region of regions) {
    trace(outline(region), true);
    const [x, y] = outline(region)[0];
    pen.font = "bold 15px sans-serif"; pen.lineWidth = 4; pen.strokeStyle = "#000"; pen.fillStyle = "#ffd000";
    pen.strokeText(region.name, (x + 0.5) * scale + 5, (y + 0.5) * scale + 17);
    pen.fillText(region.name, (x + 0.5) * scale + 5, (y + 0.5) * scale + 17);
  }
  if (from && to) trace(outline({ rectangle: rectangle(from, to) }), true);
  if (corners.length) trace(to ? [...corners, to] : corners, false);
}
function list() {
  element("list").replaceChildren(...regions.map((region, k) => {
    const row = document.createElement("tr");
    const kind = region.polygon ? `${region.polygon.length} corners` :
      `${region.rectangle.width} × ${region.rectangle.height}`;
    for (const text of [region.name, kind, `${region.edge_px || 0} px`]) row.insertCell().textContent = text;
    const button = document.createElement("button");
    button.textContent = "remove";
    button.onclick = () => { regions.splice(k, 1); list(); draw(); };
    row.insertCell().append(button);
    return row;
  }));
}
function add(region) {
  regions.push({ name: element("name").value.trim(), edge_px: Number(element("edge").value), ...region });
  element("name").value = `panel_${regions.length + 1}`;
  from = to = null; corners = [];
  list(); draw();
}
canvas.addEventListener("pointerdown", event => {
  if (shape() === "rectangle") { from = place(event); canvas.setPointerCapture(event.pointerId); }
});
canvas.addEventListener("pointermove", event => {
  const [x, y] = place(event);
  element("where").textContent = `x ${x.toFixed(1)}, y ${y.toFixed(1)}`;
  if (from || corners.length) { to = [x, y]; draw(); }
});
canvas.addEventListener("pointerup", event => {
  if (!from) return;
  const drawn = rectangle(from, place(event));
  if (drawn.width > 0 && drawn.height > 0) add({ rectangle: drawn });
  from = to = null; draw();
});
canvas.addEventListener("click", event => {
  if (shape() === "polygon" && event.detail === 1) { corners.push(place(event).map(v => Math.round(v * 10) / 10)); draw(); }
});
canvas.addEventListener("dblclick", () => {
  if (shape() === "polygon" && corners.length >= 3) add({ polygon: corners });
});
document.addEventListener("keydown", event => {
  if (event.key === "Escape") { corners = []; from = to = null; draw(); }
});
element("save").onclick = async () => {
  try {
    const answer = await fetch("regions", { method: "POST", body: JSON.stringify({ regions }) });
    element("message").textContent = answer.ok ? "Saved. This page can be closed." : await answer.text();
    element("save").disabled = answer.ok;
  } catch (error) {
    element("message").textContent = "The program that served this page has ended; nothing was saved.";
  }
};
picture.onload = () => {
  scale = Math.max(0.25, Math.min(3, (window.innerWidth - 480) / picture.width, (window.innerHeight - 160) / picture.height));
  canvas.width = Math.round(picture.width * scale);
  canvas.height = Math.round(picture.height * scale);
  pen.imageSmoothingEnabled = false;
  list(); draw();
};
fetch("regions.json").then(answer => answer.json()).then(found => {
  regions = found.regions;
  element("title").textContent = `Draw regions on ${found.title}`;
  element("name").value = `panel_${regions.length + 1}`;
  picture.src = "picture.png";
});
