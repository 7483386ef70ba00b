"use strict";
document.body.classList.add("ready");

// Sliders: the photograph over another picture of the same view. The range input brings keyboard, mouse and touch.
for (const view of document.querySelectorAll(".view")) {
  const compare = view.querySelector(".compare");
  const stage = compare.querySelector(".stage");
  const range = stage.querySelector("input");
  const picture = (kind) => view.querySelector(`.panel[data-kind="${kind}"] img`);
  const buttons = [];
  const show = (kind, title) => {
    stage.querySelector(".under").src = picture(kind).src;
    stage.querySelector(".right").textContent = title;
    for (const b of buttons) b.setAttribute("aria-pressed", String(b.dataset.kind === kind));
    range.setAttribute("aria-valuetext", `${range.value} % photograph, the rest ${title.toLowerCase()}`);
  };
  const move = () => {
    stage.style.setProperty("--share", `${range.value}%`);
    const title = stage.querySelector(".right").textContent;
    range.setAttribute("aria-valuetext", `${range.value} % photograph, the rest ${title.toLowerCase()}`);
  };
  stage.querySelector(".over").src = picture("photograph").src;
  for (const panel of view.querySelectorAll(".panel")) {
    const kind = panel.dataset.kind;
    if (kind === "photograph") continue;
    const label = panel.querySelector(".title");
    const button = document.createElement("button");
    button.type = "button";
    button.dataset.kind = kind;
    button.textContent = label.textContent;
    button.title = "Compare with the photograph";
    button.addEventListener("click", () => show(kind, button.textContent));
    label.replaceChildren(button);
    buttons.push(button);
  }
  range.addEventListener("input", move);
  show("render", "Render");
  move();
  compare.hidden = false;
}

// Charts: the value nearest to the cursor.
for (const chart of document.querySelectorAll(".chart")) {
  const svg = chart.querySelector("svg");
  if (!svg) continue;
  // Position in the drawing, then step and value as they are read.
  const points = svg.dataset.points.split(";").map((p) => p.split("|"));
  const reading = chart.querySelector(".reading");
  const last = reading.textContent;
  const cursor = svg.querySelector(".cursor");
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
    const near = points.reduce((a, b) => (Math.abs(Number(b[0]) - x) < Math.abs(Number(a[0]) - x) ? b : a));
    reading.textContent = `${near[3]} at step ${near[2]}`;
    const rule = cursor.querySelector(".rule");
    rule.setAttribute("x1", near[0]);
    rule.setAttribute("x2", near[0]);
    const mark = cursor.querySelector(".mark");
    mark.setAttribute("cx", near[0]);
    mark.setAttribute("cy", near[1]);
    cursor.setAttribute("visibility", "visible");
  });
  svg.addEventListener("pointerleave", () => {
    reading.textContent = last;
    cursor.setAttribute("visibility", "hidden");
  });
}

// The model: its page is unpacked only when asked for, and shown in a frame of its own.
const look = document.querySelector(".look");
if (look) {
  const open = look.querySelector(".open");
  const hint = document.querySelector(".look-hint");
  const first = document.querySelector('.panel[data-kind="render"] img');
  const backdrop = new Image();
  backdrop.className = "backdrop";
  backdrop.alt = "";
  if (first) backdrop.src = first.src;
  const closed = first ? [backdrop, open] : [open];
  look.replaceChildren(...closed);
  const unpacked = () => {
    const packed = atob(document.getElementById("model-page").textContent);
    const bytes = new Uint8Array(packed.length);
    for (let k = 0; k < packed.length; k++) bytes[k] = packed.charCodeAt(k);
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  };
  open.addEventListener("click", async () => {
    open.disabled = true;
    try {
      const frame = document.createElement("iframe");
      frame.title = "The model";
      frame.allow = "fullscreen";
      frame.srcdoc = await unpacked();
      frame.addEventListener("load", () => frame.contentWindow.focus());
      look.replaceChildren(frame);
      hint.hidden = false;
    } catch (problem) {
      const text = document.createElement("p");
      text.className = "problem";
      text.textContent = `The browser cannot open the viewer: ${problem.message}`;
      look.replaceChildren(text);
    }
  });
  hint.querySelector(".close").addEventListener("click", () => {
    hint.hidden = true;
    open.disabled = false;
    look.replaceChildren(...closed);
    open.focus();
  });
  look.hidden = false;
}
