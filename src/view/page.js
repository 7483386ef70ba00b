"use strict";
// The page of a model: moves a camera, asks the server for pictures, and shows how a training goes.

const $ = (id) => document.getElementById(id);
const canvas = $("picture");
const pen = canvas.getContext("2d");
const viewer = Math.floor(Math.random() * 2 ** 52);

// The token has become a cookie; the address need not keep it.
history.replaceState(null, "", location.pathname);

// ---- Vectors: arrays of three; rotations: rows of a matrix from the scene to the camera (right, down, forward).
const add = (a, b, s = 1) => a.map((v, k) => v + s * b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => a.map((v) => v / (length(a) || 1));
function turned(v, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(v.map((x) => c * x), cross(axis, v), s), axis, (1 - c) * dot(axis, v));
}
// The quaternion (w, x, y, z) of the rotation whose columns are the rows of `m`.
function quaternion(m) {
  const r = [0, 1, 2].map((i) => [0, 1, 2].map((j) => m[j][i]));
  const trace = r[0][0] + r[1][1] + r[2][2];
  if (trace > 0) {
    const s = 2 * Math.sqrt(trace + 1);
    return [s / 4, (r[2][1] - r[1][2]) / s, (r[0][2] - r[2][0]) / s, (r[1][0] - r[0][1]) / s];
  }
  const i = [0, 1, 2].reduce((a, b) => (r[b][b] > r[a][a] ? b : a));
  const [j, k] = [(i + 1) % 3, (i + 2) % 3];
  const s = 2 * Math.sqrt(1 + r[i][i] - r[j][j] - r[k][k]);
  const q = [(r[k][j] - r[j][k]) / s, 0, 0, 0];
  q[1 + i] = s / 4;
  q[1 + j] = (r[j][i] + r[i][j]) / s;
  q[1 + k] = (r[k][i] + r[i][k]) / s;
  return q;
}

// ---- State
let scene = null;
let status = null;
const camera = { position: [0, 0, 0], rows: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], focal: 1.2, distance: 1, at: null };
const shown = { channel: "colour", part: "full", drag: "orbit", share: 0 };
let bitmap = null; // the last picture
let drawnAt = null; // its camera
let photograph = null; // the photograph of camera.at
let points = []; // picked points {scene, dataset}
let wish = 1; // counts changes of what is wanted
let served = 0; // the wish of the last still picture
let drawnStep = -1;
let movedAt = -1e9;
let frames = [];

const middle = () => add(camera.position, camera.rows[2], camera.distance);
const changed = () => { wish += 1; };
function moved() {
  camera.at = null;
  photograph = null;
  movedAt = performance.now();
  changed();
  panel();
}

// ---- Moves
function orbit(dx, dy, around) {
  const target = middle();
  const pivot = around ? target : camera.position;
  const flip = dot(camera.rows[1], scene.up) > 0 ? -1 : 1;
  turn(scene.up, -dx * 0.005 * flip * (around ? 1 : -1), pivot);
  turn(camera.rows[0], -dy * 0.005 * (around ? 1 : -1), pivot);
  moved();
}
function turn(axis, angle, pivot) {
  camera.rows = camera.rows.map((row) => turned(row, axis, angle));
  camera.position = add(pivot, turned(add(camera.position, pivot, -1), axis, angle));
}
function pan(dx, dy) {
  const scale = camera.distance / (camera.focal * canvas.clientHeight);
  camera.position = add(add(camera.position, camera.rows[0], -dx * scale), camera.rows[1], -dy * scale);
  moved();
}
function zoom(factor) {
  const target = middle();
  camera.distance = Math.max(camera.distance * factor, scene.radius * 1e-4);
  camera.position = add(target, camera.rows[2], -camera.distance);
  moved();
}
function home() {
  const up = scene.up;
  // From obliquely above, from where the first camera stands.
  const first = scene.shots.length ? scene.shots[0].position : add(scene.center, [1, 0.3, 0.2]);
  let away = add(first, scene.center, -1);
  away = add(away, up, -dot(away, up));
  if (length(away) < 1e-6) away = Math.abs(up[0]) < 0.9 ? add([1, 0, 0], up, -up[0]) : add([0, 1, 0], up, -up[1]);
  const forward = unit(add(unit(away).map((v) => -0.8 * v), up, -0.6));
  camera.rows = facing(forward);
  camera.focal = 1.2;
  camera.distance = scene.radius * 3;
  camera.position = add(scene.center, forward, -camera.distance);
  moved();
}
function facing(forward) {
  let right = cross(forward, scene.up);
  if (length(right) < 1e-6) right = camera.rows[0];
  right = unit(add(right, forward, -dot(right, forward)));
  return [right, cross(forward, right), forward];
}
function jump(index) {
  const shot = scene.shots[index];
  if (!shot) return;
  camera.rows = shot.toCamera.map((row) => row.slice());
  camera.position = shot.position.slice();
  camera.focal = shot.focal;
  camera.distance = Math.max(dot(add(scene.center, shot.position, -1), camera.rows[2]), scene.radius * 0.2);
  camera.at = index;
  photograph = null;
  movedAt = -1e9;
  changed();
  panel();
  if (!shot.photograph) return;
  const image = new Image();
  image.onload = () => { if (camera.at === index) { photograph = image; paint(); panel(); } };
  image.src = `photograph?k=${index}&side=${Math.min(2048, Math.max(256, wanted()[0]))}`;
}

// ---- Pictures
function wanted() {
  const scale = window.devicePixelRatio || 1;
  const [w, h] = [canvas.clientWidth * scale, canvas.clientHeight * scale];
  const fit = Math.min(1, Math.sqrt(4e6 / (w * h)));
  return [Math.max(1, Math.round(w * fit)), Math.max(1, Math.round(h * fit))];
}
function pose() {
  if (camera.at !== null) return `k=${camera.at}`;
  return `p=${camera.position.join(",")}&q=${quaternion(camera.rows).join(",")}&f=${camera.focal}`;
}
const wait = (ms) => new Promise((done) => setTimeout(done, ms));

async function pump() {
  for (;;) {
    const moving = performance.now() - movedAt < 250;
    const stale = status && status.step !== drawnStep && status.state !== "final";
    if (document.hidden || (served === wish && !stale && !moving)) {
      await wait(40);
      continue;
    }
    await frame(moving);
  }
}

async function frame(moving) {
  const [mine, step, [w, h]] = [wish, status ? status.step : 0, wanted()];
  const [asked, keyed] = [{ ...camera, rows: camera.rows }, shown.channel];
  const address = `frame?v=${viewer}&w=${w}&h=${h}&${pose()}&c=${shown.channel}&s=${shown.part}&m=${moving ? 1 : 0}`;
  try {
    const answer = await fetch(address);
    if (answer.status === 204) return void (await wait(100));
    if (!answer.ok) return void (await trouble(await answer.text()));
    const picture = await createImageBitmap(await answer.blob());
    bitmap = picture;
    drawnAt = { ...asked, aspect: picture.width / picture.height };
    if (!moving) served = mine;
    drawnStep = step;
    message("");
    legend(keyed, answer.headers.get("X-Range"));
    frames = frames.filter((t) => t > performance.now() - 2000);
    frames.push(performance.now());
    reading(answer.headers.get("X-Size"));
    paint();
  } catch {
    await trouble("No answer from the program. It may have ended.");
  }
}
async function trouble(text) {
  message(text);
  await wait(1000);
}
function message(text) {
  $("message").hidden = !text;
  $("message").textContent = text;
}
function reading(size) {
  const rate = frames.length > 1 ? ((frames.length - 1) * 1000) / (frames[frames.length - 1] - frames[0]) : 0;
  const rated = rate > 0 && performance.now() - movedAt < 1500 ? `${rate.toFixed(1)} pictures/s · ` : "";
  $("reading").textContent = `${rated}${(size || "").replace("x", " × ")} · ${grouped(status ? status.splats : 0)} splats`;
}
function legend(channel, range) {
  $("legend").hidden = !range;
  if (!range) return;
  const unit = channel === "depth" ? 1 / scene.scale : 1;
  const [low, high] = range.split(" ").map((v) => Number(v) * unit);
  $("low").textContent = significant(low);
  $("high").textContent = channel === "error" ? `≥ ${high} / 255` : significant(high);
  $("ramp").className = channel;
}

// Where the picture lies on the canvas: (left, top, width, height) in canvas pixels.
function place() {
  const aspect = bitmap ? bitmap.width / bitmap.height : canvas.width / canvas.height;
  const width = Math.min(canvas.width, canvas.height * aspect);
  const height = width / aspect;
  return [(canvas.width - width) / 2, (canvas.height - height) / 2, width, height];
}
function paint() {
  const scale = window.devicePixelRatio || 1;
  const [w, h] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  pen.fillStyle = "#101216";
  pen.fillRect(0, 0, w, h);
  if (!bitmap) return;
  const [left, top, width, height] = place();
  pen.imageSmoothingQuality = "high";
  pen.drawImage(bitmap, left, top, width, height);
  if (photograph && camera.at !== null && shown.share > 0) {
    pen.save();
    pen.beginPath();
    pen.rect(left, top, (width * shown.share) / 100, height);
    pen.clip();
    pen.drawImage(photograph, left, top, width, height);
    pen.restore();
    pen.fillStyle = "#fff";
    pen.fillRect(left + (width * shown.share) / 100 - 1, top, 2, height);
  }
  marks();
}
function marks() {
  const scale = window.devicePixelRatio || 1;
  const places = points.map((p) => p && project(p.scene));
  pen.lineWidth = 2 * scale;
  pen.strokeStyle = "#ffd54a";
  if (places.length === 2 && places[0] && places[1]) {
    pen.beginPath();
    pen.moveTo(...places[0]);
    pen.lineTo(...places[1]);
    pen.stroke();
  }
  for (const at of places) {
    if (!at) continue;
    pen.beginPath();
    pen.arc(at[0], at[1], 5 * scale, 0, 2 * Math.PI);
    pen.stroke();
  }
}
// The canvas position of a scene point in the last picture.
function project(point) {
  const [x, y, z] = drawnAt.rows.map((row) => dot(row, add(point, drawnAt.position, -1)));
  if (z <= 0) return null;
  const [left, top, width, height] = place();
  const shot = drawnAt.at === null ? null : scene.shots[drawnAt.at];
  const [u, v] = shot ? shot.middle : [0.5, 0.5];
  const across = shot ? shot.focalAcross * width : drawnAt.focal * height;
  return [left + u * width + (x / z) * across, top + v * height + (y / z) * drawnAt.focal * height];
}

// ---- Points
async function pick(event) {
  if (!bitmap) return null;
  const scale = canvas.width / canvas.clientWidth;
  const box = canvas.getBoundingClientRect();
  const [left, top, width, height] = place();
  const [u, v] = [((event.clientX - box.left) * scale - left) / width, ((event.clientY - box.top) * scale - top) / height];
  if (u < 0 || v < 0 || u >= 1 || v >= 1) return null;
  const [w, h] = wanted();
  const answer = await fetch(`pick?v=${viewer}&w=${w}&h=${h}&${pose()}&at=${u},${v}`);
  const found = answer.status === 200 ? await answer.json() : { scene: null };
  return found.scene ? found : null;
}
function told(text) {
  $("measured").hidden = !text;
  $("measured").textContent = text;
}
async function measure(event) {
  const found = await pick(event);
  if (!found) return told("There is no surface here.");
  points = points.length === 1 ? [points[0], found] : [found];
  if (points.length === 2) {
    const [a, b] = points.map((p) => p.dataset);
    const difference = add(b, a, -1);
    const rise = dot(difference, scene.up);
    const across = Math.sqrt(Math.max(0, dot(difference, difference) - rise * rise));
    told(`Distance ${significant(length(difference))}, height ${significant(rise)}, across ${significant(across)} (units of the dataset)`);
  } else {
    // To 1e-5 of the scene, also far from the dataset's origin.
    const decimals = Math.max(0, Math.min(6, 5 - Math.floor(Math.log10(scene.radius / scene.scale))));
    told(`Point ${found.dataset.map((v) => v.toFixed(decimals)).join(", ")}. Choose a second one.`);
  }
  paint();
}
async function lookAt(event) {
  const found = await pick(event);
  if (!found) return;
  const toward = add(found.scene, camera.position, -1);
  camera.distance = length(toward);
  camera.rows = facing(unit(toward));
  moved();
}

// ---- Input: mouse, touch, wheel, keys
const pointers = new Map();
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, x0: event.clientX, y0: event.clientY, button: event.button });
  canvas.focus({ preventScroll: true });
});
canvas.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before || !scene) return;
  const [dx, dy] = [event.clientX - before.x, event.clientY - before.y];
  if (dx === 0 && dy === 0) return;
  if (pointers.size === 2) {
    const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
    const spread = (x, y) => Math.hypot(x - other.x, y - other.y);
    const [old, now] = [spread(before.x, before.y), spread(event.clientX, event.clientY)];
    if (old > 10 && now > 10) zoom(old / now);
    pan(dx / 2, dy / 2);
  } else if (before.button !== 0 || shown.drag === "pan" || event.shiftKey) {
    pan(dx, dy);
  } else if (shown.drag !== "measure" || Math.hypot(event.clientX - before.x0, event.clientY - before.y0) > 4) {
    orbit(dx, dy, shown.drag !== "look");
  }
  [before.x, before.y] = [event.clientX, event.clientY];
});
for (const end of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(end, (event) => {
    const before = pointers.get(event.pointerId);
    pointers.delete(event.pointerId);
    const still = before && Math.hypot(event.clientX - before.x0, event.clientY - before.y0) <= 4;
    if (end === "pointerup" && still && shown.drag === "measure" && before.button === 0) measure(event);
  });
}
canvas.addEventListener("dblclick", (event) => { if (shown.drag !== "measure") lookAt(event); });
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  const lines = event.deltaMode === 1 ? 30 : 1;
  if (scene) zoom(Math.exp(Math.max(-1, Math.min(1, event.deltaY * lines * 0.0015))));
}, { passive: false });

const held = new Set();
let lastFlight = 0;
let quick = false;
const FLY = { KeyW: [2, 1], KeyS: [2, -1], KeyA: [0, -1], KeyD: [0, 1], KeyQ: [1, 1], KeyE: [1, -1] };
const TURN = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
canvas.addEventListener("keydown", (event) => {
  if (!(event.code in FLY || event.code in TURN) || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  quick = event.shiftKey;
  if (held.size === 0) requestAnimationFrame(fly);
  held.add(event.code);
  lastFlight = lastFlight || performance.now() - 16;
});
window.addEventListener("keyup", (event) => { held.delete(event.code); quick = event.shiftKey; });
window.addEventListener("blur", () => held.clear());
function fly(now) {
  if (held.size === 0 || !scene) {
    lastFlight = 0;
    return;
  }
  const seconds = Math.min(0.1, Math.max(0, now - lastFlight) / 1000);
  lastFlight = now;
  const speed = camera.distance * 0.8 * seconds * (quick ? 4 : 1);
  for (const code of held) {
    if (FLY[code]) camera.position = add(camera.position, camera.rows[FLY[code][0]], FLY[code][1] * speed);
    // A key turns the view; a drag pulls the scene, so its sign is the other one.
    if (TURN[code]) orbit(-TURN[code][0] * 300 * seconds, -TURN[code][1] * 300 * seconds, false);
  }
  moved();
  requestAnimationFrame(fly);
}

// ---- Panel
function choose(group, key, act) {
  for (const button of document.querySelectorAll(`[data-${group}]`)) {
    button.addEventListener("click", () => {
      shown[key] = button.dataset[group];
      act();
      changed();
      panel();
    });
  }
}
choose("channel", "channel", () => {});
choose("part", "part", () => {});
choose("drag", "drag", () => {
  if (shown.drag !== "measure") points = [];
  canvas.classList.toggle("measure", shown.drag === "measure");
  told(shown.drag === "measure" ? "Choose two points of the surface." : "");
  paint();
});
function panel() {
  for (const group of ["channel", "part", "drag"]) {
    for (const button of document.querySelectorAll(`[data-${group}]`)) {
      button.setAttribute("aria-pressed", String(shown[group] === button.dataset[group]));
    }
  }
  const pictured = camera.at !== null && scene.shots[camera.at].photograph;
  const error = document.querySelector('[data-channel="error"]');
  error.disabled = !pictured;
  if (!pictured && shown.channel === "error") {
    shown.channel = "colour";
    changed();
    panel();
  }
  $("sliding").hidden = !pictured;
  $("photograph").value = camera.at === null ? "" : String(camera.at);
}
$("share").addEventListener("input", () => { shown.share = Number($("share").value); paint(); });
$("photograph").addEventListener("change", () => jump(Number($("photograph").value)));
const beside = (by) => jump(((camera.at === null ? (by > 0 ? -1 : 0) : camera.at) + by + scene.shots.length) % scene.shots.length);
$("previous").addEventListener("click", () => beside(-1));
$("next").addEventListener("click", () => beside(1));
$("home").addEventListener("click", home);
$("level").addEventListener("click", () => { camera.rows = facing(camera.rows[2]); moved(); });

// ---- Training
const grouped = (n) => Math.round(n).toLocaleString("en");
const significant = (v, digits = 4) => (v === 0 ? "0" : String(Number(v.toPrecision(digits))));
function duration(seconds) {
  const s = Math.round(seconds);
  if (s < 90) return `${s} s`;
  return s < 5400 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`;
}
const CURVES = [["loss", "Loss", (v) => v.toFixed(4)], ["psnr", "PSNR of held-out photographs", (v) => `${v.toFixed(2)} dB`], ["splats", "Splats", grouped]];
function curves() {
  const holder = $("curves");
  holder.replaceChildren();
  for (const [key, title, form] of CURVES) {
    const points = status.curves[key] || [];
    if (points.length < 2) continue;
    const values = points.map((p) => p[1]);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const figure = document.createElement("figure");
    figure.dataset.curve = key;
    figure.dataset.points = points.length;
    const caption = document.createElement("figcaption");
    const [name, last] = [document.createElement("span"), document.createElement("span")];
    name.textContent = title;
    last.textContent = form(values[values.length - 1]);
    caption.append(name, last);
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("viewBox", "0 0 300 56");
    svg.setAttribute("preserveAspectRatio", "none");
    svg.setAttribute("role", "img");
    svg.setAttribute("aria-label", `${title}: from ${form(values[0])} to ${form(values[values.length - 1])}`);
    const x = (step) => (300 * step) / Math.max(1, status.steps);
    if (status.lowUntil > 0 && status.lowUntil < status.steps) {
      const line = document.createElementNS(svg.namespaceURI, "line");
      for (const [k, v] of [["x1", x(status.lowUntil)], ["x2", x(status.lowUntil)], ["y1", 0], ["y2", 56]]) line.setAttribute(k, v);
      svg.append(line);
    }
    const path = document.createElementNS(svg.namespaceURI, "polyline");
    path.setAttribute("points", points.map(([s, v]) => `${x(s).toFixed(1)},${(53 - 50 * ((v - low) / (high - low || 1))).toFixed(1)}`).join(" "));
    svg.append(path);
    figure.append(caption, svg);
    holder.append(figure);
  }
}
const WORDS = { training: "", paused: "Paused. ", writing: "Writing the results. ", final: "The training is done. " };
function progress() {
  const stage = status.lowUntil > 0 && status.step < status.lowUntil ? "low frequencies" : "high frequencies";
  const staged = status.lowUntil > 0 && status.lowUntil < status.steps && status.state === "training" ? ` · ${stage}` : "";
  const left = status.left !== null && status.state === "training" ? ` · ${duration(status.left)} left` : "";
  $("progress").textContent =
    `${WORDS[status.state]}Step ${grouped(status.step)} of ${grouped(status.steps)}${staged} · ${duration(status.seconds)}${left}`;
  $("bar").value = status.steps ? status.step / status.steps : 0;
  $("note").textContent = status.note;
  const over = status.state === "writing" || status.state === "final";
  for (const id of ["pause", "save", "stop"]) $(id).disabled = over;
  $("pause").textContent = status.state === "paused" ? "Go on" : "Pause";
  curves();
}
async function send(command) {
  try {
    const answer = await fetch(command, { method: "POST" });
    if (!answer.ok) return void (await trouble(await answer.text()));
    status = await answer.json();
    progress();
  } catch {
    await trouble("No answer from the program. It may have ended.");
  }
}
$("pause").addEventListener("click", () => send(status.state === "paused" ? "resume" : "pause"));
$("save").addEventListener("click", () => send("save"));
let asked = -Infinity;
// The time of the click itself: on a busy machine it may be handled much later.
$("stop").addEventListener("click", (event) => {
  if (event.timeStamp - asked < 4000) {
    asked = -Infinity;
    $("stop").textContent = "Stop and save";
    send("stop");
    return;
  }
  asked = event.timeStamp;
  $("stop").textContent = "Really stop?";
  setTimeout(() => { $("stop").textContent = "Stop and save"; }, 4000);
});

async function poll() {
  for (;;) {
    if (!document.hidden) {
      try {
        const answer = await fetch("status");
        if (answer.ok) {
          status = await answer.json();
          if (scene.training) progress();
        }
      } catch { /* The pictures tell that nobody answers. */ }
    }
    await wait(scene.training && status && status.state !== "final" ? 700 : 3000);
  }
}

// ---- Begin
async function begin() {
  const answer = await fetch("scene");
  if (!answer.ok) return void message(await answer.text());
  scene = await answer.json();
  document.title = `${scene.title} · psrgs-vk`;
  $("title").textContent = scene.title;
  $("parts").hidden = !scene.parts;
  $("training").hidden = !scene.training;
  $("photographs").hidden = scene.shots.length === 0;
  const none = new Option("Free view", "");
  none.disabled = true;
  $("photograph").append(none, ...scene.shots.map((shot, k) => new Option(shot.heldOut ? `${shot.name} (held out)` : shot.name, k)));
  new ResizeObserver(() => { paint(); changed(); }).observe(canvas);
  if (scene.shots.length) jump(0);
  else home();
  poll();
  pump();
}
begin();
