// The live view: the newest points of each sensor and the cells of the coverage, drawn with WebGL 2. The layout of
// the messages stands in src/daemon/picture.rs.
"use strict";

const POINTS_KIND = 1;
const CELLS_KIND = 2;
const HEADER_BYTES = 32;
// revolutions of a sensor that stay on the picture
const MAX_REVOLUTIONS = 15;
const SENSOR_COLOURS = [[0.04, 0.45, 0.95], [0.93, 0.42, 0.06], [0.55, 0.25, 0.85], [0.02, 0.6, 0.55]];
// predicted and unseen, predicted and seen, seen and not predicted
const CELL_COLOURS = [[0.86, 0.12, 0.2], [0.1, 0.62, 0.3], [0.45, 0.5, 0.58]];

const POINT_SHADER = `#version 300 es
in vec3 place; in float shine; uniform mat4 clip_from_world; uniform vec3 origin; uniform float metres;
uniform vec3 colour; uniform float size; uniform float age; out vec4 paint;
void main() {
  gl_Position = clip_from_world * vec4(origin + place * metres, 1.0);
  gl_PointSize = size;
  paint = vec4(colour * (0.65 + 0.5 * shine), age);
}`;
const CELL_SHADER = `#version 300 es
in vec3 place; in float state; uniform mat4 clip_from_world; uniform vec3 origin; uniform float metres;
uniform vec3 colours[3]; uniform float focal; out vec4 paint;
void main() {
  gl_Position = clip_from_world * vec4(origin + (place + 0.5) * metres, 1.0);
  gl_PointSize = clamp(metres * focal / gl_Position.w, 1.0, 64.0);
  paint = vec4(colours[int(state)], state < 0.5 ? 0.75 : 0.28);
}`;
const LINE_SHADER = `#version 300 es
in vec3 place; uniform mat4 clip_from_world; uniform vec3 colour; out vec4 paint;
void main() { gl_Position = clip_from_world * vec4(place, 1.0); paint = vec4(colour, 1.0); }`;
const PAINT_SHADER = `#version 300 es
precision mediump float; in vec4 paint; out vec4 colour; void main() { colour = paint; }`;

class Scene {
  constructor(canvas) {
    this.canvas = canvas;
    this.showPoints = true;
    this.showCells = true;
    this.clouds = new Map();
    this.cells = null;
    this.begin();
    this.gl = canvas.getContext("webgl2", { alpha: false, antialias: true, preserveDrawingBuffer: true });
    this.drawn = 0;
    if (!this.gl) return;
    this.points = this.program(POINT_SHADER);
    this.cellProgram = this.program(CELL_SHADER);
    this.lines = this.program(LINE_SHADER);
    this.ground = this.makeGround();
    this.listen();
    new ResizeObserver(() => this.ask()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.ask());
    this.ask();
  }

  // the view from behind and above
  begin() {
    Object.assign(this, { yaw: 3.6, tilt: 0.65, distance: 22, middle: [0, 0, 0], fitted: false });
  }

  program(vertex) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, PAINT_SHADER]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    const at = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(program, name)) });
    return { program, at, attribute: (name) => gl.getAttribLocation(program, name) };
  }

  buffer(bytes, attach) {
    const gl = this.gl;
    const [array, buffer] = [gl.createVertexArray(), gl.createBuffer()];
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
    attach(gl);
    return { array, buffer };
  }

  free(part) {
    if (!part) return;
    this.gl.deleteVertexArray(part.array);
    this.gl.deleteBuffer(part.buffer);
  }

  makeGround() {
    const places = [];
    for (let at = -20; at <= 20; at += 2) places.push(at, -20, 0, at, 20, 0, -20, at, 0, 20, at, 0);
    const axes = [0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 2];
    const attach = (gl) => {
      gl.enableVertexAttribArray(0);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 12, 0);
    };
    this.gl.bindAttribLocation(this.lines.program, 0, "place");
    this.gl.linkProgram(this.lines.program);
    return [[places, 84], [axes, 6]].map(([list]) => ({ ...this.buffer(new Float32Array(list), attach), count: list.length / 3 }));
  }

  // takes a message of the stream; the kernel's stamp of points, UTC ns
  take(message) {
    const head = new DataView(message, 0, HEADER_BYTES);
    const [kind, sensor, count] = [head.getUint8(0), head.getUint8(1), head.getUint32(4, true)];
    const origin = [16, 20, 24].map((at) => head.getFloat32(at, true));
    const metres = head.getFloat32(28, true);
    if (this.gl) {
      const part = { origin, metres, count, sensor };
      if (kind === POINTS_KIND) this.takePoints(part, message);
      if (kind === CELLS_KIND) this.takeCells(part, message);
      this.ask();
    }
    return { kind, sensor, count, timeNs: head.getBigUint64(8, true) };
  }

  takePoints(part, message) {
    const { program } = this.points;
    Object.assign(part, this.buffer(new Uint8Array(message, HEADER_BYTES), (gl) => {
      this.attach(program, "place", 3, gl.SHORT, false, 0);
      this.attach(program, "shine", 1, gl.UNSIGNED_BYTE, true, 6);
    }));
    const cloud = this.clouds.get(part.sensor) ?? [];
    cloud.push(part);
    while (cloud.length > MAX_REVOLUTIONS) this.free(cloud.shift());
    this.clouds.set(part.sensor, cloud);
    if (!this.fitted && !this.cells?.count) this.fit(new Int16Array(message, HEADER_BYTES), part);
  }

  takeCells(part, message) {
    const { program } = this.cellProgram;
    Object.assign(part, this.buffer(new Uint8Array(message, HEADER_BYTES), (gl) => {
      this.attach(program, "place", 3, gl.UNSIGNED_SHORT, false, 0);
      this.attach(program, "state", 1, gl.UNSIGNED_BYTE, false, 6);
    }));
    this.free(this.cells);
    this.cells = part;
    if (!this.fitted && part.count > 0) this.fit(new Uint16Array(message, HEADER_BYTES), part);
  }

  attach(program, name, size, kind, normalized, offset) {
    const gl = this.gl;
    const at = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, kind, normalized, 8, offset);
  }

  // looks at all of a part
  fit(places, { origin, metres, count }) {
    if (count === 0) return;
    const [least, most] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (let at = 0; at < count; at++) {
      for (let axis = 0; axis < 3; axis++) {
        const value = origin[axis] + places[4 * at + axis] * metres;
        least[axis] = Math.min(least[axis], value);
        most[axis] = Math.max(most[axis], value);
      }
    }
    this.middle = least.map((low, axis) => (low + most[axis]) / 2);
    this.distance = Math.max(4, 1.1 * Math.hypot(...most.map((high, axis) => high - least[axis])));
    this.fitted = true;
  }

  fitAll() {
    this.begin();
    this.ask();
  }

  // draws once, soon; where drawing is slow (no graphics card), more seldom, so that the buttons stay quick
  ask() {
    if (this.asked || !this.gl) return;
    this.asked = true;
    setTimeout(() => {
      const wanted = performance.now();
      requestAnimationFrame(() => {
        this.pause = Math.min(600, Math.max(50, 3 * (performance.now() - wanted)));
        this.asked = false;
        this.draw();
      });
    }, this.pause ?? 0);
  }

  draw() {
    const { gl, canvas } = this;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const ground = rgb(getComputedStyle(canvas).backgroundColor);
    const dark = ground[0] < 0.5;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...ground, 1);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const focal = height / (2 * Math.tan(0.4));
    const matrix = this.matrix(width / Math.max(height, 1));
    gl.useProgram(this.lines.program);
    gl.uniformMatrix4fv(this.lines.at.clip_from_world, false, matrix);
    for (const [part, colour] of [[this.ground[0], dark ? [0.17, 0.2, 0.24] : [0.78, 0.81, 0.85]], [this.ground[1], dark ? [0.9, 0.9, 0.9] : [0.1, 0.1, 0.1]]]) {
      gl.uniform3fv(this.lines.at.colour, colour);
      gl.bindVertexArray(part.array);
      gl.drawArrays(gl.LINES, 0, part.count);
    }
    let drawn = 0;
    if (this.showCells && this.cells) {
      gl.depthMask(false);
      gl.useProgram(this.cellProgram.program);
      gl.uniformMatrix4fv(this.cellProgram.at.clip_from_world, false, matrix);
      gl.uniform1f(this.cellProgram.at.focal, focal);
      gl.uniform3fv(this.cellProgram.at.colours, CELL_COLOURS.flat());
      drawn += this.drawPart(this.cellProgram, this.cells);
      gl.depthMask(true);
    }
    if (this.showPoints) {
      gl.useProgram(this.points.program);
      gl.uniformMatrix4fv(this.points.at.clip_from_world, false, matrix);
      gl.uniform1f(this.points.at.size, 1.8 * ratio);
      for (const [sensor, cloud] of this.clouds) {
        gl.uniform3fv(this.points.at.colour, SENSOR_COLOURS[sensor % SENSOR_COLOURS.length]);
        cloud.forEach((part, at) => {
          gl.uniform1f(this.points.at.age, (at + 1 + MAX_REVOLUTIONS - cloud.length) / MAX_REVOLUTIONS);
          drawn += this.drawPart(this.points, part);
        });
      }
    }
    this.drawn = drawn;
    canvas.dataset.drawn = drawn;
  }

  drawPart({ at }, part) {
    this.gl.uniform3fv(at.origin, part.origin);
    this.gl.uniform1f(at.metres, part.metres);
    this.gl.bindVertexArray(part.array);
    this.gl.drawArrays(this.gl.POINTS, 0, part.count);
    return part.count;
  }

  // perspective times a camera that looks at the middle, z up
  matrix(aspect) {
    const [near, far] = [this.distance / 200, this.distance * 8];
    const f = 1 / Math.tan(0.4);
    const [cy, sy, ct, st] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.tilt), Math.sin(this.tilt)];
    const back = [cy * ct, sy * ct, st];
    const right = [-sy, cy, 0];
    const up = [-cy * st, -sy * st, ct];
    const eye = this.middle.map((middle, axis) => middle + this.distance * back[axis]);
    const dot = (a) => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
    const [sx, k, m] = [f / aspect, (far + near) / (near - far), (2 * far * near) / (near - far)];
    const column = (i) => [sx * right[i], f * up[i], k * back[i], -back[i]];
    return new Float32Array([...column(0), ...column(1), ...column(2), sx * dot(right), f * dot(up), k * dot(back) + m, -dot(back)]);
  }

  listen() {
    const { canvas } = this;
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const apart = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
        this.nearer(apart(before) / Math.max(apart(now), 1));
      } else {
        this.turn((now[0] - before[0]) * -0.008, (now[1] - before[1]) * 0.008);
      }
      fingers.set(event.pointerId, now);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.nearer(Math.exp(event.deltaY * 0.001));
    }, { passive: false });
    const keys = {
      ArrowLeft: () => this.turn(0.1, 0), ArrowRight: () => this.turn(-0.1, 0),
      ArrowUp: () => this.turn(0, 0.1), ArrowDown: () => this.turn(0, -0.1),
      "+": () => this.nearer(0.85), "=": () => this.nearer(0.85), "-": () => this.nearer(1.18), 0: () => this.fitAll(),
    };
    canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
    });
  }

  turn(yaw, tilt) {
    this.yaw += yaw;
    this.tilt = Math.min(1.55, Math.max(-1.2, this.tilt + tilt));
    this.ask();
  }

  nearer(factor) {
    this.distance = Math.min(400, Math.max(0.5, this.distance * factor));
    this.ask();
  }
}

function rgb(text) {
  const found = text.match(/[\d.]+/g) ?? [0, 0, 0];
  return found.slice(0, 3).map((value) => Number(value) / 255);
}

function css(colour) {
  return `rgb(${colour.map((value) => Math.round(value * 255)).join(" ")})`;
}
