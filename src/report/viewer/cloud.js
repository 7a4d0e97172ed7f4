// Draws point clouds with WebGL 2: an orbit camera over revolutions, each a buffer of positions and one of values.
"use strict";

const VERTEX = `#version 300 es
in vec3 place; in float value; in float range;
uniform mat4 clip_from_world; uniform mat4 world_from_points; uniform float size; uniform vec2 limits; uniform vec2 ranges;
uniform bool is_flat; uniform vec3 flat_colour; uniform sampler2D palette; out vec3 paint;
void main() {
  gl_Position = clip_from_world * world_from_points * vec4(place, 1.0);
  if (range < ranges.x || range > ranges.y) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = size;
  float share = clamp((value - limits.x) / max(limits.y - limits.x, 1e-9), 0.0, 1.0);
  paint = is_flat ? flat_colour : texture(palette, vec2(share, 0.5)).rgb;
}`;
const LINE = `#version 300 es
in vec3 place; uniform mat4 clip_from_world; uniform mat4 world_from_points; uniform float size; uniform vec3 colour; out vec3 paint;
void main() { gl_Position = clip_from_world * world_from_points * vec4(place, 1.0); gl_PointSize = size; paint = colour; }`;
const PAINT = `#version 300 es
precision mediump float; in vec3 paint; out vec4 colour; void main() { colour = vec4(paint, 1.0); }`;

// stops of palettes that people with any colour vision can read, from low to high
const PALETTES = {
  viridis: ["440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725"],
  cividis: ["00224e", "123570", "3b496c", "575d6d", "707173", "8a8678", "a59c74", "c3b369", "e1cc55", "fee838"],
  inferno: ["000004", "1b0c41", "4a0c6b", "781c6d", "a52c60", "cf4446", "ed6925", "fb9b06", "f7d13d", "fcffa4"],
  grey: ["202020", "ffffff"],
};
// Okabe and Ito
const SENSOR_COLOURS = ["0072b2", "e69f00", "009e73", "cc79a7", "56b4e9", "d55e00", "f0e442", "999999"];

function rgb(hex) {
  return [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
}

function paletteBytes(name) {
  const stops = PALETTES[name].map(rgb);
  const bytes = new Uint8Array(256 * 4);
  for (let at = 0; at < 256; at++) {
    const place = (at / 255) * (stops.length - 1);
    const [low, high] = [stops[Math.floor(place)], stops[Math.ceil(place)]];
    const share = place - Math.floor(place);
    for (let channel = 0; channel < 3; channel++) bytes[4 * at + channel] = 255 * (low[channel] * (1 - share) + high[channel] * share);
    bytes[4 * at + 3] = 255;
  }
  return bytes;
}

const IDENTITY = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);

class CloudView {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    Object.assign(this, { size: 1.6, ranges: [0, 1e9], limits: [0, 1], showGrid: true, track: null, marks: [] });
    this.reset();
    if (!this.gl) return;
    this.points = this.program(VERTEX, ["place", "value", "range"]);
    this.lines = this.program(LINE, ["place"]);
    this.paletteTexture = this.gl.createTexture();
    this.setPalette("viridis");
    this.grid = this.makeGrid();
    this.axes = this.line([0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1]);
    this.listen();
    new ResizeObserver(() => this.ask()).observe(canvas);
  }

  reset() {
    Object.assign(this, { yaw: 3.7, tilt: 0.6, distance: 25, middle: [0, 0, 0] });
    this.ask();
  }

  look(yaw, tilt) {
    Object.assign(this, { yaw, tilt });
    this.ask();
  }

  program(vertex, names) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, PAINT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    names.forEach((name, at) => gl.bindAttribLocation(program, at, name));
    gl.linkProgram(program);
    const at = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(program, name)) });
    return { program, at };
  }

  setPalette(name) {
    const gl = this.gl;
    if (!gl) return;
    gl.bindTexture(gl.TEXTURE_2D, this.paletteTexture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, paletteBytes(name));
    for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, key, value);
    }
    this.ask();
  }

  attribute(at, size, data) {
    const gl = this.gl;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, gl.FLOAT, false, 0, 0);
    return buffer;
  }

  // a cloud on the graphics card
  upload(places, values, ranges) {
    const gl = this.gl;
    if (!gl) return null;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [this.attribute(0, 3, places), this.attribute(1, 1, values), this.attribute(2, 1, ranges)];
    return { array, buffers, count: places.length / 3 };
  }

  // a row of a cloud anew: 1 values, 2 ranges
  setRow(part, row, values) {
    const gl = this.gl;
    if (!part) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, part.buffers[row]);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  }

  free(part) {
    if (!part) return;
    this.gl.deleteVertexArray(part.array);
    part.buffers.forEach((buffer) => this.gl.deleteBuffer(buffer));
  }

  line(places) {
    const array = this.gl.createVertexArray();
    this.gl.bindVertexArray(array);
    return { array, buffers: [this.attribute(0, 3, new Float32Array(places))], count: places.length / 3 };
  }

  // range rings every 10 m, and a cross
  makeGrid() {
    const places = [];
    for (let radius = 10; radius <= 100; radius += 10) {
      for (let at = 0; at < 96; at++) {
        for (const step of [at, at + 1]) places.push(radius * Math.cos((step * Math.PI) / 48), radius * Math.sin((step * Math.PI) / 48), 0);
      }
    }
    places.push(-100, 0, 0, 100, 0, 0, 0, -100, 0, 0, 100, 0);
    return this.line(places);
  }

  setTrack(places) {
    this.free(this.track);
    this.track = places.length >= 6 ? this.line(places) : null;
    this.ask();
  }

  setMarks(places) {
    if (!this.gl) return;
    this.marks.forEach((part) => this.free(part));
    this.marks = places.map((place) => this.line(place));
    this.ask();
  }

  // draws once, soon
  ask() {
    if (this.asked || !this.gl) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  // shown: [{part, matrix, colour (flat) or null}]
  show(shown) {
    this.shown = shown;
    this.ask();
  }

  draw() {
    const { gl, canvas } = this;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...(dark ? [0.04, 0.05, 0.06] : [0.12, 0.13, 0.15]), 1);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const clip = this.matrix(width / Math.max(height, 1));
    gl.useProgram(this.lines.program);
    gl.uniformMatrix4fv(this.lines.at.clip_from_world, false, clip);
    gl.uniformMatrix4fv(this.lines.at.world_from_points, false, IDENTITY);
    gl.uniform1f(this.lines.at.size, 9 * ratio);
    const lines = this.showGrid ? [[this.grid, [0.27, 0.3, 0.34], gl.LINES], [this.axes, [0.85, 0.85, 0.85], gl.LINES]] : [];
    if (this.track) lines.push([this.track, [1, 1, 1], gl.LINE_STRIP]);
    for (const mark of this.marks) lines.push([mark, [1, 0.1, 0.6], mark.count > 1 ? gl.LINES : gl.POINTS]);
    for (const [part, colour, kind] of lines) {
      gl.uniform3fv(this.lines.at.colour, colour);
      gl.bindVertexArray(part.array);
      gl.drawArrays(kind, 0, part.count);
    }
    gl.useProgram(this.points.program);
    gl.uniformMatrix4fv(this.points.at.clip_from_world, false, clip);
    gl.uniform1f(this.points.at.size, this.size * ratio);
    gl.uniform2fv(this.points.at.limits, this.limits);
    gl.uniform2fv(this.points.at.ranges, this.ranges);
    gl.bindTexture(gl.TEXTURE_2D, this.paletteTexture);
    let drawn = 0;
    for (const { part, matrix, colour } of this.shown ?? []) {
      if (!part) continue;
      gl.uniformMatrix4fv(this.points.at.world_from_points, false, matrix ?? IDENTITY);
      gl.uniform1i(this.points.at.is_flat, colour ? 1 : 0);
      gl.uniform3fv(this.points.at.flat_colour, colour ?? [1, 1, 1]);
      gl.bindVertexArray(part.array);
      gl.drawArrays(gl.POINTS, 0, part.count);
      drawn += part.count;
    }
    canvas.dataset.drawn = drawn;
    canvas.dataset.frames = Number(canvas.dataset.frames ?? 0) + 1;
  }

  // perspective times a camera that looks at the middle, z up
  matrix(aspect) {
    const [near, far] = [this.distance / 100, this.distance * 20 + 200];
    const f = 1 / Math.tan(0.4);
    const { back, right, up } = this.camera();
    const eye = this.middle.map((middle, axis) => middle + this.distance * back[axis]);
    const dot = (a) => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
    const [sx, k, m] = [f / aspect, (far + near) / (near - far), (2 * far * near) / (near - far)];
    const column = (i) => [sx * right[i], f * up[i], k * back[i], -back[i]];
    return new Float32Array([...column(0), ...column(1), ...column(2), sx * dot(right), f * dot(up), k * dot(back) + m, -dot(back)]);
  }

  camera() {
    const [cy, sy, ct, st] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.tilt), Math.sin(this.tilt)];
    return { back: [cy * ct, sy * ct, st], right: [-sy, cy, 0], up: [-cy * st, -sy * st, ct] };
  }

  // the point under a pixel: number in its cloud, and the cloud's place among those shown; null where none is near
  pick(x, y, clouds) {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const clip = this.matrix(width / Math.max(height, 1));
    let best = null;
    clouds.forEach(({ places, ranges, matrix }, cloud) => {
      const m = product(clip, matrix ?? IDENTITY);
      for (let at = 0; at < places.length / 3; at++) {
        if (ranges[at] < this.ranges[0] || ranges[at] > this.ranges[1]) continue;
        const [px, py, pz] = [places[3 * at], places[3 * at + 1], places[3 * at + 2]];
        const w = m[3] * px + m[7] * py + m[11] * pz + m[15];
        if (w <= 0) continue;
        const sx = ((m[0] * px + m[4] * py + m[8] * pz + m[12]) / w + 1) * 0.5 * width - x;
        const sy = (1 - (m[1] * px + m[5] * py + m[9] * pz + m[13]) / w) * 0.5 * height - y;
        const apart = sx * sx + sy * sy;
        if (apart > 64) continue;
        // the nearest to the eye among those under the pointer
        const rank = w * (1 + apart / 16);
        if (!best || rank < best.rank) best = { cloud, at, rank };
      }
    });
    return best;
  }

  listen() {
    const { canvas } = this;
    const fingers = new Map();
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      this.moved = 0;
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      this.moved += Math.abs(dx) + Math.abs(dy);
      if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const apart = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
        this.nearer(apart(before) / Math.max(apart(now), 1));
      } else if (event.buttons === 2 || event.shiftKey) {
        this.pan(dx, dy);
      } else {
        this.yaw -= dx * 0.008;
        this.tilt = Math.min(1.5707, Math.max(-1.5707, this.tilt + dy * 0.008));
        this.ask();
      }
      fingers.set(event.pointerId, now);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.nearer(Math.exp(event.deltaY * 0.001));
    }, { passive: false });
  }

  pan(dx, dy) {
    const { right, up } = this.camera();
    const metres = (2 * Math.tan(0.4) * this.distance) / Math.max(this.canvas.clientHeight, 1);
    this.middle = this.middle.map((middle, axis) => middle + metres * (-dx * right[axis] + dy * up[axis]));
    this.ask();
  }

  nearer(factor) {
    this.distance = Math.min(2000, Math.max(0.3, this.distance * factor));
    this.ask();
  }
}

// of two matrices by columns
function product(a, b) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      for (let k = 0; k < 4; k++) out[4 * column + row] += a[4 * k + row] * b[4 * column + k];
    }
  }
  return out;
}
