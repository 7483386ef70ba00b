// Unpacks the viewer and the model from this page, then shows the model. Nothing is asked of any network.
const note = document.getElementById("note");
const text = (id) => document.getElementById(id).textContent;
const bytes = (id) => {
  const packed = atob(text(id));
  const out = new Uint8Array(packed.length);
  for (let k = 0; k < packed.length; k++) out[k] = packed.charCodeAt(k);
  return out;
};
const unpacked = (id) =>
  new Response(new Blob([bytes(id)]).stream().pipeThrough(new DecompressionStream("gzip"))).text();

try {
  if (!("DecompressionStream" in window)) throw new Error("the browser is too old: it cannot unpack gzip");
  const style = document.createElement("style");
  style.textContent = await unpacked("viewer-css");
  document.head.append(style);
  const module = URL.createObjectURL(new Blob([await unpacked("viewer-js")], { type: "text/javascript" }));
  const { createViewer } = await import(module);
  URL.revokeObjectURL(module);
  // Switches of the viewer's own page.
  const asked = new URLSearchParams(location.search);
  const viewer = await createViewer({
    ...JSON.parse(text("options")),
    container: document.body,
    contentUrl: "model.sog",
    contentFilename: "model.sog",
    contents: Promise.resolve(new Response(bytes("model"))),
    renderer: asked.has("webgl") ? "webgl" : "webgpu",
    ui: !asked.has("noui"),
    noanim: true,
  });
  if (viewer.app.graphicsDevice.deviceType === "null") throw new Error("the browser has neither WebGPU nor WebGL 2");
  // The viewer begins in its animation, which stands still: the first camera is that of the page.
  viewer.events.once("loaded:changed", () => {
    viewer.state.cameraMode = "orbit";
    viewer.resetCamera();
    document.body.classList.add("shown");
  });
  note.hidden = true;
} catch (problem) {
  note.textContent = `The model cannot be shown: ${problem.message}`;
  note.hidden = false;
}
