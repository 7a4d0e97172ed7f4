// The one 3-D viewer, of recordings, reports and the daemon's page: points, lines and surfaces with WebGL 2, under a camera that
// goes around or stands inside.
"use strict";

const VERTEX = `
in vec3 place; in float value; in float range;
uniform mat4 clip_from_points; uniform mat4 world_from_points; uniform float size; uniform float metres; uniform float focal;
uniform vec2 limits; uniform vec2 ranges; uniform bool is_flat; uniform vec4 flat_colour; uniform sampler2D palette;
uniform bool is_limited; uniform bool is_boxed; uniform vec3 box_middle; uniform vec3 box_half; uniform vec2 box_turn; uniform float top;
out vec4 paint;
#ifdef SOLID
out vec3 at;
#endif
void main() {
  gl_Position = clip_from_points * vec4(place, 1.0);
  bool is_out = range < ranges.x || range > ranges.y;
#ifdef SOLID
  at = (world_from_points * vec4(place, 1.0)).xyz;
#else
  if (is_limited) {
    vec3 at = (world_from_points * vec4(place, 1.0)).xyz;
    vec3 off = at - box_middle;
    vec2 turned = vec2(box_turn.x * off.x + box_turn.y * off.y, box_turn.x * off.y - box_turn.y * off.x);
    is_out = is_out || at.z > top || (is_boxed && any(greaterThan(abs(vec3(turned, off.z)), box_half)));
  }
  gl_PointSize = metres > 0.0 ? clamp(metres * focal / max(gl_Position.w, 0.01), size, 64.0) : size;
#endif
  if (is_out) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  float share = clamp((value - limits.x) / max(limits.y - limits.x, 1e-9), 0.0, 1.0);
  paint = is_flat ? flat_colour : vec4(texelFetch(palette, ivec2(int(share * 255.0), 0), 0).rgb, flat_colour.a);
}`;
const FRAGMENT = `
precision highp float; in vec4 paint; out vec4 colour;
#ifdef SOLID
in vec3 at; uniform float top; uniform bool is_shaded;
#endif
void main() {
  colour = paint;
#ifdef SOLID
  if (at.z > top) discard;
  if (is_shaded) colour.rgb *= 0.6 + 0.4 * abs(dot(normalize(cross(dFdx(at), dFdy(at))), vec3(0.35, 0.2, 0.915)));
#endif
}`;
// how many points a picture has while the camera moves: at first, and at least; in between as many as the machine can draw in time
const BUDGET = 200000;
const LEAST_BUDGET = 20000;
// pictures while the camera moves: closer than the first, more points; farther apart than the second, fewer, ms
const PICTURE_MS = [36, 60];
const REST_MS = 250;

const IDENTITY = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);

// limits of what is drawn, m
const EVERYWHERE = [0, 1e9];

class CloudView {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { alpha: false, antialias: false, preserveDrawingBuffer: true });
    Object.assign(this, { size: 1.6, ranges: EVERYWHERE, limits: [0, 1], top: 1e9, box: null, showGrid: true, showAxes: true, track: null, marks: [] });
    Object.assign(this, { home: { yaw: 3.7, tilt: 0.6, distance: 25, middle: [0, 0, 0] }, ground: null });
    this.fingers = new Map(); // that hold the picture
    this.reset();
    if (!this.gl) return;
    this.programs = { points: this.link(""), solid: this.link("#define SOLID\n") };
    this.budget = BUDGET;
    this.paletteTexture = this.gl.createTexture();
    this.setPalette("viridis");
    this.grid = this.makeGrid();
    this.axes = ["d55e00", "009e73", "56b4e9"].map((colour, axis) => [this.line([0, 1].flatMap((end) => [0, 1, 2].map((other) => (other === axis ? end : 0)))), rgb(colour)]);
    this.listen();
    new ResizeObserver(() => this.ask()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.ask());
  }

  reset() {
    Object.assign(this, this.home, { middle: [...this.home.middle], isInside: false });
    this.ask();
  }

  look(yaw, tilt) {
    Object.assign(this, { yaw, tilt, isInside: false });
    this.ask();
  }

  // the whole of a box in the picture, now and after every reset
  fit(low, high) {
    const across = Math.hypot(...high.map((value, axis) => value - low[axis]));
    this.home = { ...this.home, middle: low.map((value, axis) => (value + high[axis]) / 2), distance: Math.max(1, 1.25 * across) };
    this.reset();
  }

  // from where a person stands
  enter(eye, yaw) {
    Object.assign(this, { middle: [...eye], yaw: yaw + Math.PI, tilt: 0, isInside: true });
    this.ask();
  }

  link(define) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, `#version 300 es\n${define}${text}`);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ["place", "value", "range"].forEach((name, at) => gl.bindAttribLocation(program, at, name));
    gl.linkProgram(program);
    const at = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(program, name)) });
    return { program, at };
  }

  // compiled meanwhile: the page does not wait for it before there is something to draw
  ensureLinked() {
    const gl = this.gl;
    if (this.isLinked) return;
    for (const { program } of Object.values(this.programs)) {
      if (gl.getProgramParameter(program, gl.LINK_STATUS)) continue;
      const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
      throw new Error([gl.getProgramInfoLog(program), ...logs].join("\n"));
    }
    this.isLinked = true;
  }

  setPalette(name) {
    const gl = this.gl;
    if (!gl) return;
    gl.bindTexture(gl.TEXTURE_2D, this.paletteTexture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, paletteBytes(name));
    for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.NEAREST], [gl.TEXTURE_MAG_FILTER, gl.NEAREST], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, key, value);
    }
    this.ask();
  }

  attribute(at, size, data) {
    const gl = this.gl;
    const kind = { Float32Array: gl.FLOAT, Int16Array: gl.SHORT, Uint16Array: gl.UNSIGNED_SHORT, Uint8Array: gl.UNSIGNED_BYTE }[data.constructor.name];
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, kind, false, 0, 0);
    return buffer;
  }

  // positions of any kind of number on the graphics card, with a value and a range each where these are given
  upload(places, values, ranges) {
    const gl = this.gl;
    if (!gl) return null;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [places, values, ranges].map((row, at) => row && this.attribute(at, at === 0 ? 3 : 1, row));
    return { array, buffers, count: places.length / 3, isMixed: false };
  }

  // the same of points of which a part may be drawn
  uploadPoints(places, values, ranges) {
    const part = this.upload(...[places, values, ranges].map((row, at) => row && mixed(row, at === 0 ? 3 : 1)));
    return part && Object.assign(part, { isMixed: true });
  }

  // rewrites a row of a cloud: 1 values, 2 ranges
  setRow(part, row, values) {
    const gl = this.gl;
    if (!part) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, part.buffers[row]);
    gl.bufferData(gl.ARRAY_BUFFER, part.isMixed ? mixed(values, 1) : values, gl.STATIC_DRAW);
  }

  free(part) {
    if (!part) return;
    this.gl.deleteVertexArray(part.array);
    part.buffers.forEach((buffer) => buffer && this.gl.deleteBuffer(buffer));
  }

  line(places) {
    return this.upload(new Float32Array(places));
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
    if (!this.gl) return;
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

  // draws once, soon; where drawing is slow (no graphics card), more seldom if asked to leave time for the rest of the page
  ask() {
    if (this.asked || !this.gl) return;
    this.asked = true;
    const begin = () => {
      const wanted = performance.now();
      requestAnimationFrame(() => {
        this.asked = false;
        this.draw();
        if (this.isPolite) this.pause = Math.min(600, Math.max(50, 3 * (performance.now() - wanted)));
      });
    };
    const isPaced = (this.turnedAt ?? -1) > (this.drawnAt ?? 0) && this.budget > LEAST_BUDGET;
    if (this.pause && !isPaced) setTimeout(begin, this.pause);
    else begin();
  }

  // shown: [{part, matrix, colour (flat, of 3 or 4) or null, kind, metres (size of a point), isShaded, isWhole, isOnTop, ranges}]
  show(shown) {
    this.shown = shown;
    this.ask();
  }

  draw() {
    const { gl, canvas } = this;
    this.ensureLinked();
    this.share = this.pace();
    this.ratio = Math.min(devicePixelRatio || 1, this.share < 1 ? 1 : 2);
    const [width, height] = [canvas.clientWidth * this.ratio, canvas.clientHeight * this.ratio].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...(this.ground ?? (dark ? [0.04, 0.05, 0.06] : [0.12, 0.13, 0.15])), 1);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.clip = this.matrix(width / Math.max(height, 1));
    const { middle, half, yaw } = this.box ?? { middle: [0, 0, 0], half: [1, 1, 1], yaw: 0 };
    gl.bindTexture(gl.TEXTURE_2D, this.paletteTexture);
    for (const { program, at } of Object.values(this.programs)) {
      gl.useProgram(program);
      gl.uniform1f(at.focal, height / (2 * Math.tan(0.4)));
      gl.uniform3fv(at.box_middle, middle);
      gl.uniform3fv(at.box_half, half);
      gl.uniform2f(at.box_turn, Math.cos(yaw), Math.sin(yaw));
      gl.uniform2fv(at.limits, this.limits);
    }
    const lines = this.showGrid ? [[this.grid, [0.5, 0.53, 0.58, 0.45], gl.LINES]] : [];
    if (this.showAxes) lines.push(...this.axes.map(([part, colour]) => [part, colour, gl.LINES]));
    if (this.track) lines.push([this.track, this.trackColour ?? [1, 1, 1], gl.LINE_STRIP]);
    for (const [part, colour, kind] of lines) this.drawPart({ part, colour, kind, isWhole: true });
    let drawn = 0;
    for (const item of this.shown ?? []) if (item.part) drawn += this.drawPart(item);
    for (const part of this.marks) this.drawPart({ part, colour: [1, 0.1, 0.6], kind: part.count > 1 ? gl.LINES : gl.POINTS, size: 9, isWhole: true, isOnTop: true });
    canvas.dataset.drawn = this.drawn = drawn;
    canvas.dataset.frames = Number(canvas.dataset.frames ?? 0) + 1;
  }

  // which share of the points is drawn: all of them when nothing moves, else what comes in time
  pace() {
    const now = performance.now();
    const before = this.drawnAt ?? 0;
    const since = now - before;
    this.drawnAt = now;
    const isMoving = (this.turnedAt ?? -1) > before || this.fingers.size > 0;
    const isOn = isMoving && this.isMoving; // so was the picture before: the time between the two is that of a picture
    this.isMoving = isMoving;
    if (!isMoving) return 1;
    const points = (this.shown ?? []).reduce((sum, { part }) => sum + (part?.isMixed ? part.count : 0), 0);
    const [close, far] = PICTURE_MS;
    if (isOn && since < close) this.budget = Math.min(1.5 * this.budget, Math.max(points, BUDGET));
    if (isOn && since > far) this.budget = Math.max(LEAST_BUDGET, this.budget * Math.max(0.4, (0.8 * far) / since));
    clearTimeout(this.full);
    if (this.fingers.size === 0) this.full = setTimeout(() => this.ask(), Math.max(REST_MS, isOn ? 3 * since : 0));
    return Math.min(1, this.budget / Math.max(points, 1));
  }

  drawPart({ part, matrix, colour, kind, size, metres, isShaded, isWhole, isOnTop, ranges }) {
    const { gl } = this;
    const isSolid = kind !== undefined && kind !== gl.POINTS;
    const { program, at } = isSolid ? this.programs.solid : this.programs.points;
    const isBoxed = Boolean(this.box) && !isWhole;
    gl.useProgram(program);
    gl.uniformMatrix4fv(at.world_from_points, false, matrix ?? IDENTITY);
    gl.uniformMatrix4fv(at.clip_from_points, false, matrix ? product(this.clip, matrix) : this.clip);
    gl.uniform1i(at.is_flat, colour ? 1 : 0);
    gl.uniform4fv(at.flat_colour, colour ? [...colour.slice(0, 3), colour[3] ?? 1] : [1, 1, 1, 1]);
    gl.uniform1f(at.size, (size ?? this.size) * this.ratio);
    gl.uniform1f(at.metres, metres ?? 0);
    gl.uniform2fv(at.ranges, isWhole ? [-1, 1e30] : ranges ?? this.ranges);
    gl.uniform1i(at.is_boxed, isBoxed ? 1 : 0);
    gl.uniform1i(at.is_limited, isBoxed || (!isWhole && this.top < 1e9) ? 1 : 0);
    gl.uniform1f(at.top, isWhole ? 1e9 : this.top);
    gl.uniform1i(at.is_shaded, isShaded ? 1 : 0);
    (isOnTop ? gl.disable : gl.enable).call(gl, gl.DEPTH_TEST);
    gl.depthMask((colour?.[3] ?? 1) >= 1);
    gl.bindVertexArray(part.array);
    const count = part.isMixed ? Math.ceil(part.count * this.share) : part.count;
    gl.drawArrays(kind ?? gl.POINTS, 0, count);
    gl.depthMask(true);
    return count;
  }

  // perspective times a camera that looks at the middle (or from it, inside), z up
  matrix(aspect) {
    const [near, far] = this.isInside ? [0.05, 3000] : [this.distance / 100, this.distance * 20 + 200];
    const f = 1 / Math.tan(0.4);
    const { back, right, up } = this.camera();
    const eye = this.eye();
    const dot = (a) => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
    const [sx, k, m] = [f / aspect, (far + near) / (near - far), (2 * far * near) / (near - far)];
    const column = (i) => [sx * right[i], f * up[i], k * back[i], -back[i]];
    return new Float32Array([...column(0), ...column(1), ...column(2), sx * dot(right), f * dot(up), k * dot(back) + m, -dot(back)]);
  }

  eye() {
    const { back } = this.camera();
    return this.middle.map((middle, axis) => middle + (this.isInside ? 0 : this.distance * back[axis]));
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
        if (this.box && !this.isInBox(px, py, pz, matrix)) continue;
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

  // whether a point lies in the crop box
  isInBox(x, y, z, m) {
    const at = m ? [0, 1, 2].map((row) => m[row] * x + m[4 + row] * y + m[8 + row] * z + m[12 + row]) : [x, y, z];
    const { middle, half, yaw } = this.box;
    const off = at.map((value, axis) => value - middle[axis]);
    const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    return Math.abs(c * off[0] + s * off[1]) <= half[0] && Math.abs(c * off[1] - s * off[0]) <= half[1] && Math.abs(off[2]) <= half[2];
  }

  listen() {
    const { canvas } = this;
    const { fingers } = this;
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      this.moved = 0;
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => {
        fingers.delete(event.pointerId);
        if (fingers.size === 0) this.ask(); // all of the points again
      });
    }
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      this.moved += Math.abs(dx) + Math.abs(dy);
      if (fingers.size === 2) {
        // two fingers: apart comes nearer, together along moves
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const apart = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
        this.nearer(apart(before) / Math.max(apart(now), 1));
        this.pan(dx / 2, dy / 2);
      } else if (event.buttons === 2 || event.shiftKey) {
        this.pan(dx, dy);
      } else {
        this.turn(dx * (this.isInside ? 0.004 : -0.008), dy * (this.isInside ? -0.004 : 0.008));
      }
      fingers.set(event.pointerId, now);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.nearer(Math.exp(event.deltaY * 0.001));
    }, { passive: false });
  }

  turn(yaw, tilt) {
    this.turnedAt = performance.now();
    this.yaw += yaw;
    this.tilt = Math.min(1.5707, Math.max(-1.5707, this.tilt + tilt));
    this.ask();
  }

  pan(dx, dy) {
    this.turnedAt = performance.now();
    const { right, up } = this.camera();
    const metres = (2 * Math.tan(0.4) * (this.isInside ? 5 : this.distance)) / Math.max(this.canvas.clientHeight, 1);
    this.middle = this.middle.map((middle, axis) => middle + metres * (-dx * right[axis] + dy * up[axis]));
    this.ask();
  }

  // below 1 comes nearer; inside, steps forward
  nearer(factor) {
    this.turnedAt = performance.now();
    if (this.isInside) {
      const { back } = this.camera();
      this.middle = this.middle.map((middle, axis) => middle + 5 * (factor - 1) * back[axis]);
    } else {
      this.distance = Math.min(2000, Math.max(0.3, this.distance * factor));
    }
    this.ask();
  }
}

// numbers of points (one or three each) in an order of which every beginning is a sample of all: by steps of the golden
// section through the next power of two, without what lies past the end (an odd step meets each place once)
function mixed(row, size) {
  const count = row.length / size;
  const out = new row.constructor(row.length);
  let places = 1;
  while (places < count) places *= 2;
  const step = Math.round(0.618034 * places) | 1;
  for (let to = 0, from = 0; to < row.length; from = (from + step) % places) {
    if (from >= count) continue;
    for (let at = 0; at < size; at++) out[to++] = row[size * from + at];
  }
  return out;
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
