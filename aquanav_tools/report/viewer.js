// Shows a glTF scene (GLB, y up) that lies in the page as base64: triangles and lines with colours at their corners.
// Turn by dragging, move by dragging with the right button or Shift, zoom with the wheel or two fingers.
"use strict";

const TRIANGLES = `attribute vec3 place, normal; attribute vec4 colour; uniform mat4 view; uniform vec3 eye;
varying vec3 n, v; varying vec4 c;
void main() { n = normal; v = eye - place; c = colour; gl_Position = view * vec4(place, 1.0); }`;
const LIT = `precision mediump float; varying vec3 n, v; varying vec4 c; uniform float alpha;
void main() {
  vec3 m = normalize(n), w = normalize(v); if (dot(m, w) < 0.0) m = -m;
  float light = 0.40 + 0.55 * max(dot(m, w), 0.0) + 0.35 * max(dot(m, normalize(vec3(0.3, 1.0, 0.2))), 0.0);
  gl_FragColor = vec4(pow(c.rgb * light, vec3(1.0 / 2.2)) * alpha, alpha);
}`;
const LINES = `attribute vec3 place, next; attribute float side; attribute vec4 colour; uniform mat4 view;
uniform vec2 size; uniform float width; varying vec4 c;
void main() {
  vec4 a = view * vec4(place, 1.0), b = view * vec4(next, 1.0);
  vec2 way = (b.xy / b.w - a.xy / a.w) * size; float far = length(way);
  vec2 across = far > 1e-6 ? vec2(-way.y, way.x) / far : vec2(0.0);
  a.xy += side * width * across / size * a.w; a.z -= 2e-4 * a.w; c = colour; gl_Position = a;
}`;
const PLAIN = `precision mediump float; varying vec4 c; void main() { gl_FragColor = vec4(pow(c.rgb, vec3(1.0 / 2.2)), 1.0); }`;

function readGlb(bytes) {
  const head = new DataView(bytes), jsonSize = head.getUint32(12, true);
  const text = new TextDecoder().decode(new Uint8Array(bytes, 20, jsonSize));
  const scene = JSON.parse(text), start = 28 + jsonSize;
  const types = { 5126: Float32Array, 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array };
  const sizes = { SCALAR: 1, VEC3: 3, VEC4: 4 }, most = { 5121: 255, 5123: 65535 };
  const values = (index) => {
    const accessor = scene.accessors[index], view = scene.bufferViews[accessor.bufferView];
    const found = new types[accessor.componentType](bytes, start + (view.byteOffset || 0), accessor.count * sizes[accessor.type]);
    return accessor.normalized ? Float32Array.from(found, (x) => x / most[accessor.componentType]) : found;
  };
  return scene.nodes.filter((node) => node.mesh !== undefined).flatMap((node) => scene.meshes[node.mesh].primitives.map((part) => ({
    name: node.name, isLine: part.mode === 1, place: values(part.attributes.POSITION),
    normal: part.attributes.NORMAL === undefined ? null : values(part.attributes.NORMAL),
    colour: values(part.attributes.COLOR_0), index: part.indices === undefined ? null : values(part.indices),
  })));
}

function asRibbon(part) { // lines as triangles: four corners for each piece, moved apart by the shader
  const count = part.place.length / 6, place = [], next = [], side = [], colour = [], index = [];
  for (let k = 0; k < count; k++) {
    const a = part.place.slice(6 * k, 6 * k + 3), b = part.place.slice(6 * k + 3, 6 * k + 6);
    const beyond = a.map((x, n) => 2 * b[n] - x), first = 4 * k;
    for (const [from, to, sign, at] of [[a, b, -1, 2 * k], [a, b, 1, 2 * k], [b, beyond, -1, 2 * k + 1], [b, beyond, 1, 2 * k + 1]]) {
      place.push(...from); next.push(...to); side.push(sign); colour.push(...part.colour.slice(4 * at, 4 * at + 4));
    }
    index.push(first, first + 1, first + 2, first + 2, first + 1, first + 3);
  }
  return { ...part, place: Float32Array.from(place), next: Float32Array.from(next), side: Float32Array.from(side),
    colour: Float32Array.from(colour), index: Uint32Array.from(index) };
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const s = Math.hypot(...a) || 1; return a.map((x) => x / s); };

function viewMatrix(camera, aspect) {
  const flat = Math.cos(camera.pitch), back = [flat * Math.sin(camera.yaw), Math.sin(camera.pitch), flat * Math.cos(camera.yaw)];
  const eye = camera.target.map((x, k) => x + camera.distance * back[k]);
  const right = unit(cross([0, 1, 0], back)), up = cross(back, right);
  const f = 1 / Math.tan(0.35), near = 0.01 * camera.distance, far = camera.distance + 4 * camera.radius;
  const p = (far + near) / (near - far), q = 2 * far * near / (near - far);
  const rows = [right.map((x) => x * f / aspect), up.map((x) => x * f), back.map((x) => x * p), back.map((x) => -x)];
  const last = rows.map((row, k) => -dot(row, eye) + (k === 2 ? q : 0));
  const matrix = [0, 1, 2].flatMap((k) => rows.map((row) => row[k])).concat(last);
  return { matrix: Float32Array.from(matrix), eye, right, up };
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}

function upload(gl, part) {
  const buffers = {};
  for (const [name, size] of [["place", 3], ["normal", 3], ["next", 3], ["side", 1], ["colour", 4]]) {
    if (!part[name]) continue;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.bufferData(gl.ARRAY_BUFFER, part[name], gl.STATIC_DRAW);
    buffers[name] = { buffer, size };
  }
  const index = gl.createBuffer();
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, index);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, Uint32Array.from(part.index), gl.STATIC_DRAW);
  return { name: part.name, isLine: part.isLine, buffers, index, count: part.index.length };
}

function show(figure) {
  const canvas = figure.querySelector("canvas"), gl = canvas.getContext("webgl", { preserveDrawingBuffer: true });
  if (!gl || !gl.getExtension("OES_element_index_uint")) throw new Error("This browser shows no WebGL.");
  const raw = atob(figure.querySelector("script").textContent.trim()), bytes = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
  const parts = readGlb(bytes.buffer), low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
  for (const part of parts.filter((one) => one.name === "cave"))
    for (let k = 0; k < part.place.length; k++) {
      low[k % 3] = Math.min(low[k % 3], part.place[k]); high[k % 3] = Math.max(high[k % 3], part.place[k]);
    }
  const radius = 0.5 * Math.hypot(...high.map((x, k) => x - low[k])), spans = high.map((x, k) => x - low[k]);
  const yaw = (spans[0] >= spans[2] ? 0 : 0.5 * Math.PI) + 0.35; // towards its longer side
  const home = () => ({ target: high.map((x, k) => 0.5 * (x + low[k])), distance: 1.75 * radius, radius, yaw, pitch: 0.6 });
  const solid = program(gl, TRIANGLES, LIT), line = program(gl, LINES, PLAIN);
  const meshes = parts.map((part) => upload(gl, part.isLine ? asRibbon(part) : part));
  const isOpen = figure.querySelector("input");
  let camera = home(), isWaiting = false;

  const draw = () => {
    isWaiting = false;
    const scale = window.devicePixelRatio || 1, width = Math.round(canvas.clientWidth * scale), height = Math.round(canvas.clientHeight * scale);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.03, 0.09, 0.13, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST); gl.disable(gl.BLEND); gl.depthMask(true);
    const view = viewMatrix(camera, width / height);
    for (const mesh of meshes) {
      const isCave = mesh.name === "cave", cull = isCave && isOpen.checked;
      if (cull) { gl.enable(gl.CULL_FACE); gl.cullFace(gl.FRONT); } else gl.disable(gl.CULL_FACE);
      paint(mesh, view, 1, width, height, scale);
    }
    if (!isOpen.checked) return; // the near wall as a breath of glass
    gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA); gl.depthMask(false);
    gl.enable(gl.CULL_FACE); gl.cullFace(gl.BACK);
    for (const mesh of meshes) if (mesh.name === "cave") paint(mesh, view, 0.07, width, height, scale);
    gl.depthMask(true);
  };
  const paint = (mesh, view, alpha, width, height, scale) => {
    const chosen = mesh.isLine ? line : solid;
    gl.useProgram(chosen);
    gl.uniformMatrix4fv(gl.getUniformLocation(chosen, "view"), false, view.matrix);
    if (mesh.isLine) {
      gl.uniform2f(gl.getUniformLocation(chosen, "size"), width, height);
      gl.uniform1f(gl.getUniformLocation(chosen, "width"), (["route", "goal"].includes(mesh.name) ? 2.5 : 1.6) * scale);
    } else {
      gl.uniform3fv(gl.getUniformLocation(chosen, "eye"), view.eye);
      gl.uniform1f(gl.getUniformLocation(chosen, "alpha"), alpha);
    }
    const used = [];
    for (const [name, { buffer, size }] of Object.entries(mesh.buffers)) {
      const at = gl.getAttribLocation(chosen, name);
      if (at < 0) continue;
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.enableVertexAttribArray(at); used.push(at);
      gl.vertexAttribPointer(at, size, gl.FLOAT, false, 0, 0);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.index);
    gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
    for (const at of used) gl.disableVertexAttribArray(at);
  };
  const redraw = () => { if (!isWaiting) { isWaiting = true; requestAnimationFrame(draw); } };
  const zoom = (factor) => { camera.distance = Math.min(Math.max(camera.distance * factor, 0.02 * radius), 8 * radius); };

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => { fingers.set(event.pointerId, event); canvas.setPointerCapture(event.pointerId); });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const x = event.clientX - before.clientX, y = event.clientY - before.clientY;
    const other = [...fingers.values()].find((one) => one.pointerId !== event.pointerId);
    if (other) {
      const gap = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
      zoom(gap(before) / Math.max(gap(event), 1));
    } else if (event.shiftKey || event.buttons === 2) {
      const view = viewMatrix(camera, 1), step = 0.73 * camera.distance / canvas.clientHeight;
      camera.target = camera.target.map((p, k) => p + step * (y * view.up[k] - x * view.right[k]));
    } else {
      camera.yaw -= 0.008 * x;
      camera.pitch = Math.min(Math.max(camera.pitch + 0.008 * y, -1.55), 1.55);
    }
    fingers.set(event.pointerId, event);
    redraw();
  });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(0.0012 * event.deltaY)); redraw(); }, { passive: false });
  canvas.addEventListener("dblclick", () => { camera = home(); redraw(); });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  isOpen.addEventListener("change", redraw);
  new ResizeObserver(redraw).observe(canvas);
  draw();
}

for (const figure of document.querySelectorAll("figure.model"))
  try { show(figure); } catch (error) { figure.querySelector("canvas").replaceWith(`No 3D view: ${error.message}`); }
