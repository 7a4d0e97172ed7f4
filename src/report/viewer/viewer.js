// The page around the cloud: what is shown of a recording, when, and in which colours.
"use strict";

const find = (id) => document.getElementById(id);
const HEADER = 40;
// revolutions stored beyond those on the picture
const SPARE = 12;
const AT_ONCE = 3;
const SAMPLE = 2000;
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 10];

// asked for before anything that takes its time
const firstIndex = fetch("api/recording/0");
const view = new CloudView(find("cloud"));
find("no-gl").hidden = Boolean(view.gl);

const state = {
  sensors: [], // {name, product, channels, body_from_sensor, revolutions, matrix, isOn}
  start: 0, end: 0, // host time, s
  time: 0, // since the start, s
  isPlaying: false, isLooping: false, speed: 3,
  loaded: new Map(), // "frame/sensor/revolution" -> cloud
  loading: new Set(), failed: new Set(),
  picked: [], isWhole: false, isFitted: false, heading: {},
};

function key(sensor, revolution) {
  return `${find("frame").value === "world" ? "world" : "sensor"}/${sensor}/${revolution}`;
}

// ---- the index

async function readIndex() {
  const known = state.sensors.map((sensor) => sensor.revolutions.length).join(",");
  const index = await (await (known ? fetch(`api/recording/${known}`) : firstIndex)).json();
  state.heading = index;
  index.sensors.forEach((sensor, at) => {
    if (!state.sensors[at]) {
      state.sensors[at] = { ...sensor, revolutions: [], isOn: true, matrix: matrixOf(sensor.body_from_sensor) };
      addSensor(at);
    }
    state.sensors[at].revolutions.push(...sensor.revolutions);
  });
  const firsts = state.sensors.map((sensor) => sensor.revolutions[0]).filter(Boolean);
  if (firsts.length > 0) {
    state.start = Math.min(...firsts.map((revolution) => revolution.host_time_ns[0])) * 1e-9;
    state.end = Math.max(...state.sensors.map((sensor) => sensor.revolutions.at(-1)?.host_time_ns[1] ?? 0)) * 1e-9;
  }
  state.isWhole = index.is_whole;
  find("title").textContent = index.recording;
  document.title = `${index.recording}: Outrigger`;
  const lost = state.sensors.reduce((sum, sensor) => sum + (sensor.revolutions.at(-1)?.lost_packets ?? 0), 0);
  find("state").textContent =
    `${index.is_whole ? "" : "reading: "}${state.sensors.map((sensor) => sensor.revolutions.length).join(" + ")} revolutions, ` +
    `${(state.end - state.start).toFixed(1)} s, ${lost === 0 ? "no packets lost" : `${lost} packets lost`}`;
  find("problems").replaceChildren(...index.problems.map((problem) => element("li", problem)));
  if (index.is_whole) document.body.dataset.whole = "1";
  offerFrames();
  update();
  readScene();
  if (!index.is_whole) readOn();
}

// more of the index once there is a picture: until then the program leaves the processor to it
function readOn(waited = 0) {
  const isDrawn = view.drawn > 0 || !view.gl || waited > 2000;
  if (isDrawn && waited >= 300) readIndex();
  else setTimeout(() => readOn(waited + 50), 50);
}

function element(kind, text) {
  return Object.assign(document.createElement(kind), { textContent: text });
}

function matrixOf(rows) {
  if (!rows) return null;
  const out = new Float32Array(16);
  rows.forEach((row, r) => row.forEach((value, column) => (out[4 * column + r] = value)));
  out[15] = 1;
  return out;
}

function addSensor(at) {
  const sensor = state.sensors[at];
  const label = document.createElement("label");
  const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
  box.addEventListener("change", () => {
    sensor.isOn = box.checked;
    update();
  });
  sensor.box = box;
  const name = element("span", `${at + 1} ${sensor.name}`);
  name.style.borderLeft = `.5rem solid #${SENSOR_COLOURS[at % SENSOR_COLOURS.length]}`;
  name.style.paddingLeft = ".3rem";
  label.append(name, box);
  find("sensors").append(label);
  const figure = document.createElement("figure");
  const canvas = document.createElement("canvas");
  figure.append(canvas, element("figcaption", sensor.name));
  find("images").append(figure);
  sensor.canvas = canvas;
  canvas.setAttribute("aria-label", `Image of ${sensor.name}: columns across, rings down`);
  canvas.addEventListener("pointermove", (event) => fromImage(at, event));
}

function offerFrames() {
  const select = find("frame");
  const offered = [...select.options].map((option) => option.value);
  const offer = (value, text) => {
    if (offered.includes(value)) return;
    select.append(Object.assign(element("option", text), { value }));
    if (!state.isFitted) select.value = value;
  };
  if (state.sensors.length > 0 && state.sensors.every((sensor) => sensor.body_from_sensor)) offer("rig", "rig");
  if (state.heading.trajectory) offer("world", `world (${state.heading.trajectory})`);
}

// ---- which revolutions

function current(sensor) {
  const list = state.sensors[sensor].revolutions;
  const now = (state.start + state.time) * 1e9;
  let [low, high] = [0, list.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle].host_time_ns[0] <= now + 1e3) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

function wanted() {
  const decay = Math.max(1, Number(find("decay").value) || 1);
  const places = [];
  state.sensors.forEach((sensor, at) => {
    if (!sensor.isOn) return;
    const last = current(at);
    for (let number = last; number >= Math.max(0, last - decay + 1); number--) places.push([at, number]);
  });
  return places;
}

function update() {
  if (state.sensors.length === 0) return;
  follow();
  const places = wanted();
  // those ahead come before they are needed
  const ahead = state.sensors.flatMap((sensor, at) => [1, 2, 3].map((step) => [at, current(at) + step]))
    .filter(([at, number]) => state.sensors[at].isOn && number < state.sensors[at].revolutions.length);
  for (const [at, number] of [...places, ...(state.isPlaying ? ahead : [])]) load(at, number);
  show(places);
  forget(new Set([...places, ...ahead].map(([at, number]) => key(at, number))));
  drawTimeline();
  if (view.drawn > 0) drawImages();
  else requestAnimationFrame(() => setTimeout(drawImages)); // the picture comes first
  say();
}

async function load(sensor, revolution) {
  const name = key(sensor, revolution);
  if (state.loaded.has(name) || state.loading.has(name) || state.failed.has(name) || state.loading.size >= AT_ONCE) return;
  state.loading.add(name);
  try {
    const answer = await fetch(`api/points/${name}`);
    if (!answer.ok) throw new Error(await answer.text());
    const cloud = unpack(await answer.arrayBuffer());
    cloud.name = name;
    const values = valuesOf(cloud);
    cloud.sample = sampleOf(values);
    cloud.part = view.uploadPoints(cloud.places, values, cloud.ranges);
    state.loaded.set(name, cloud);
    document.body.dataset.loaded = state.loaded.size;
    if (!state.isFitted) fit(cloud);
  } catch (error) {
    state.failed.add(name);
    find("problems").append(element("li", `revolution ${revolution} of ${state.sensors[sensor].name}: ${error.message}`));
  }
  state.loading.delete(name);
  update();
}

function unpack(buffer) {
  const head = new DataView(buffer);
  const count = head.getUint32(0, true);
  let at = HEADER;
  const next = (Kind) => {
    const row = new Kind(buffer, at, count * (Kind === Float32Array && at === HEADER ? 3 : 1));
    at += row.byteLength;
    return row;
  };
  const places = next(Float32Array);
  const cloud = {
    count, places, sensor: head.getUint32(4, true), revolution: head.getUint32(8, true), unplaced: head.getUint32(12, true),
    columns: head.getUint32(32, true), channels: head.getUint32(36, true), startNs: head.getBigUint64(16, true),
    range_mm: next(Uint32Array), since_ns: next(Uint32Array), column: next(Uint16Array), ring: next(Uint16Array),
    intensity: next(Uint16Array), near_ir: next(Uint16Array), reflectivity: next(Uint8Array), return_number: next(Uint8Array),
  };
  cloud.ranges = hideReturns(cloud);
  return cloud;
}

// ranges, m; of returns that are not wanted beyond all limits
function hideReturns(cloud) {
  const only = find("returns").value;
  const ranges = scaled(cloud.range_mm, 1e-3);
  if (only !== "all") cloud.return_number.forEach((number, at) => number !== Number(only) && (ranges[at] = 1e12));
  return ranges;
}

function valuesOf(cloud) {
  switch (find("colour").value) {
    case "height": {
      const matrix = matrixFor(cloud.sensor);
      const [a, b, c, d] = matrix ? [matrix[2], matrix[6], matrix[10], matrix[14]] : [0, 0, 1, 0];
      const { places } = cloud;
      const heights = new Float32Array(cloud.count);
      for (let at = 0; at < heights.length; at++) heights[at] = a * places[3 * at] + b * places[3 * at + 1] + c * places[3 * at + 2] + d;
      return heights;
    }
    case "range": return scaled(cloud.range_mm, 1e-3);
    case "time": return scaled(cloud.since_ns, 1e-6);
    case "sensor": return new Float32Array(cloud.count);
    default: return Float32Array.from(cloud[find("colour").value]);
  }
}

function scaled(row, factor) {
  const out = new Float32Array(row.length);
  for (let at = 0; at < row.length; at++) out[at] = row[at] * factor;
  return out;
}

// every n-th of them in order, some thousand
function sampleOf(values) {
  const step = Math.max(1, Math.floor(values.length / SAMPLE));
  return Float32Array.from({ length: Math.ceil(values.length / step) }, (_, at) => values[step * at]).sort();
}

function matrixFor(sensor) {
  return find("frame").value === "rig" ? state.sensors[sensor].matrix : null;
}

function show(places) {
  const clouds = places.map(([at, number]) => state.loaded.get(key(at, number))).filter(Boolean);
  state.shown = clouds;
  const isFlat = find("colour").value === "sensor";
  view.limits = limits(clouds);
  view.ranges = [Number(find("least").value) || 0, Number(find("most").value) || 1e9];
  applyCrop();
  const ground = find("frame").value === "world" && state.isSceneShown && state.scene ? [state.scene] : [];
  view.show([...ground, ...clouds.map((cloud) => ({
    part: cloud.part, matrix: matrixFor(cloud.sensor),
    colour: isFlat ? rgb(SENSOR_COLOURS[cloud.sensor % SENSOR_COLOURS.length]) : null,
  }))]);
  const [low, high] = view.limits;
  const digits = high - low < 10 ? 1 : 0;
  find("low").textContent = isFlat ? "" : low.toFixed(digits);
  find("high").textContent = isFlat ? "" : high.toFixed(digits);
  find("legend").hidden = isFlat;
}

// second and 98th percentile of what is shown
function limits(clouds) {
  const name = `${find("colour").value} ${clouds.map((cloud) => cloud.name)}`;
  if (state.limitsOf === name) return view.limits;
  state.limitsOf = name;
  const sample = Float32Array.from(clouds.flatMap((cloud) => [...cloud.sample])).sort();
  if (sample.length === 0) return view.limits;
  const at = (share) => sample[Math.round(share * (sample.length - 1))];
  return [at(0.02), Math.max(at(0.98), at(0.02) + 1e-6)];
}

function forget(needed) {
  const spare = [...state.loaded.keys()].filter((name) => !needed.has(name));
  for (const name of spare.slice(0, Math.max(0, spare.length - SPARE))) {
    view.free(state.loaded.get(name).part);
    state.loaded.delete(name);
  }
}

function recolour() {
  state.limitsOf = null;
  for (const cloud of state.loaded.values()) {
    const values = valuesOf(cloud);
    cloud.sample = sampleOf(values);
    view.setRow(cloud.part, 1, values);
  }
  drawBar();
  update();
}

function chooseReturns() {
  for (const cloud of state.loaded.values()) {
    cloud.ranges = hideReturns(cloud);
    view.setRow(cloud.part, 2, cloud.ranges);
  }
  update();
}

function forgetAll() {
  for (const cloud of state.loaded.values()) view.free(cloud.part);
  state.loaded.clear();
  state.failed.clear();
  state.limitsOf = null;
  state.picked = [];
  view.setMarks([]);
  const track = find("frame").value === "world" ? state.heading.track_m.flat() : [];
  view.setTrack(track);
  update();
}

function fit(cloud) {
  state.isFitted = true;
  const ranges = sampleOf(cloud.range_mm);
  const far = (ranges[Math.floor(0.9 * ranges.length)] ?? 10000) * 1e-3;
  if (!location.hash) view.distance = Math.max(3, 2.2 * far);
  if (find("frame").value === "world" && cloud.count > 0 && !location.hash) view.middle = [...cloud.places.slice(0, 3)];
  if (find("frame").value === "world") view.setTrack(state.heading.track_m.flat());
  view.ask();
}

// ---- where the rig is

// pose of the trajectory at the time shown: x, y, z, m, and heading, rad; that of the sensor's own frame without a trajectory
function poseNow() {
  const { track_m: track, track_time_s: times } = state.heading;
  if (find("frame").value !== "world" || !track?.length) return [0, 0, 0, 0];
  // a sensor that counts from power-on is dated by the host
  const own = Number(state.shown?.[0]?.startNs ?? 0n) * 1e-9;
  const now = own >= times[0] && own <= times.at(-1) ? own : state.start + state.time;
  let at = times.findIndex((time) => time > now);
  if (at < 0) at = times.length - 1;
  return [...track[Math.max(0, at - 1)], state.heading.track_heading_rad[Math.max(0, at - 1)]];
}

function follow() {
  const [x, y, z, heading] = poseNow();
  if (state.isFollowing && !view.isInside) view.middle = [x, y, z];
  if (state.isInside) {
    const turned = view.isInside ? view.yaw - Math.PI - state.headingBefore : 0;
    const tilt = view.isInside ? view.tilt : 0;
    view.enter([x, y, z], heading + turned);
    view.tilt = tilt;
    state.headingBefore = heading;
  }
  press("o", state.isFollowing);
  press("i", state.isInside);
}

function press(name, isPressed) {
  document.querySelector(`button[data-key="${name}"]`).setAttribute("aria-pressed", Boolean(isPressed));
}

function leave() {
  Object.assign(state, { isFollowing: false, isInside: false });
}

async function readScene() {
  if (!state.heading.scene || state.scene || !view.gl) return;
  state.scene = { part: null };
  const buffer = await (await fetch("api/scene")).arrayBuffer();
  const isSurface = new DataView(buffer).getUint32(0, true) === 1;
  const part = view.upload(new Float32Array(buffer, 8));
  const kind = isSurface ? view.gl.TRIANGLES : view.gl.POINTS;
  state.scene = { part, colour: [0.5, 0.54, 0.58], kind, isShaded: isSurface, isWhole: true, metres: isSurface ? 0 : 0.05 };
  state.isSceneShown = true;
  document.querySelector('button[data-key="m"]').hidden = false;
  document.body.dataset.scene = part.count;
  update();
}

// ---- time

function seek(time) {
  state.time = Math.min(Math.max(0, time), Math.max(0, state.end - state.start));
  update();
}

function step(revolutions) {
  const on = state.sensors.findIndex((sensor) => sensor.isOn);
  if (on < 0) return;
  const list = state.sensors[on].revolutions;
  const number = Math.min(Math.max(0, current(on) + revolutions), list.length - 1);
  if (list[number]) seek(list[number].host_time_ns[0] * 1e-9 - state.start + 1e-6);
}

let lastTick = null;
function tick(now) {
  if (!state.isPlaying) {
    lastTick = null;
    return;
  }
  const isHere = wanted().every(([at, number]) => number < 0 || state.loaded.has(key(at, number)) || state.failed.has(key(at, number)));
  if (lastTick !== null && isHere) {
    const time = state.time + ((now - lastTick) / 1000) * SPEEDS[state.speed];
    if (time > state.end - state.start && state.isWhole) {
      if (state.isLooping) state.time = 0;
      else play(false);
    } else state.time = Math.min(time, state.end - state.start);
    update();
  }
  lastTick = now;
  requestAnimationFrame(tick);
}

function play(isPlaying) {
  state.isPlaying = isPlaying;
  find("play").textContent = isPlaying ? "Pause" : "Play";
  if (isPlaying) {
    if (state.time >= state.end - state.start) state.time = 0;
    lastTick = null;
    requestAnimationFrame(tick);
  }
  update();
}

function say() {
  const on = state.sensors.findIndex((sensor) => sensor.isOn);
  const number = on < 0 ? -1 : current(on);
  find("time").textContent = `${state.time.toFixed(2)} s of ${(state.end - state.start).toFixed(2)} s, revolution ${number}, ${SPEEDS[state.speed]}x`;
  find("command").textContent = decodeCommand();
  find("cut").textContent = cutCommand();
  find("timeline").setAttribute("aria-valuemax", (state.end - state.start).toFixed(1));
  find("timeline").setAttribute("aria-valuenow", state.time.toFixed(2));
}

function drawTimeline() {
  const canvas = find("timeline");
  const ratio = devicePixelRatio || 1;
  Object.assign(canvas, { width: canvas.clientWidth * ratio, height: canvas.clientHeight * ratio });
  const paint = canvas.getContext("2d");
  const span = Math.max(state.end - state.start, 1e-3);
  const x = (seconds) => (seconds / span) * canvas.width;
  const rows = Math.max(state.sensors.length, 1);
  const height = (canvas.height - 16 * ratio) / rows;
  state.sensors.forEach((sensor, at) => {
    let lost = 0;
    for (const revolution of sensor.revolutions) {
      const [first, last] = revolution.host_time_ns.map((time) => time * 1e-9 - state.start);
      paint.fillStyle = `#${SENSOR_COLOURS[at % SENSOR_COLOURS.length]}`;
      paint.globalAlpha = sensor.isOn ? 1 : 0.3;
      paint.fillRect(x(first), at * height + 1, Math.max(1, x(last) - x(first)), height - 2);
      if (revolution.lost_packets > lost) {
        paint.fillStyle = "#d00";
        paint.fillRect(x(first) - 1, at * height, Math.max(3, x(last) - x(first)), height);
      }
      lost = revolution.lost_packets;
    }
  });
  paint.globalAlpha = 1;
  const ink = getComputedStyle(document.body).color;
  paint.fillStyle = ink;
  paint.fillRect(x(state.time) - ratio, 0, 2 * ratio, canvas.height);
  paint.font = `${11 * ratio}px system-ui`;
  const tick = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600].find((seconds) => span / seconds < 12) ?? 7200;
  for (let at = 0; at <= span; at += tick) paint.fillText(`${Number(at.toFixed(1))} s`, x(at) + 2, canvas.height - 3 * ratio);
}

// ---- images

function drawImages() {
  const field = find("image").value;
  state.sensors.forEach((sensor, at) => {
    const cloud = state.loaded.get(key(at, current(at)));
    sensor.canvas.parentElement.hidden = !sensor.isOn || !(cloud ?? sensor.cloud);
    const name = `${cloud?.name} ${field} ${find("palette").value}`;
    if (!cloud || sensor.imageOf === name) return;
    sensor.imageOf = name;
    sensor.cloud = cloud;
    const { columns, channels } = cloud;
    Object.assign(sensor.canvas, { width: columns, height: channels });
    const paint = sensor.canvas.getContext("2d");
    const image = paint.createImageData(columns, channels);
    const values = field === "range" ? cloud.range_mm : cloud[field];
    const sorted = sampleOf(values);
    const [low, high] = [sorted[Math.floor(0.02 * sorted.length)] ?? 0, sorted[Math.floor(0.98 * (sorted.length - 1))] ?? 1];
    const palette = new Uint32Array(paletteBytes(find("palette").value).buffer);
    const pixels = new Uint32Array(image.data.buffer);
    const isRising = state.sensors[at].product.toLowerCase().match(/vlp|hdl|vls|puck/); // Velodyne rings rise
    for (let point = 0; point < cloud.count; point++) {
      if (cloud.return_number[point] === 2) continue;
      const row = isRising ? channels - 1 - cloud.ring[point] : cloud.ring[point];
      const share = Math.min(1, Math.max(0, (values[point] - low) / Math.max(high - low, 1)));
      pixels[row * columns + cloud.column[point]] = palette[Math.round(255 * share)];
    }
    paint.putImageData(image, 0, 0);
    sensor.isRising = Boolean(isRising);
    sensor.canvas.style.height = `${Math.max(40, Math.min(128, channels))}px`;
  });
}

function fromImage(at, event) {
  const sensor = state.sensors[at];
  const cloud = sensor.cloud;
  if (!cloud) return;
  const box = sensor.canvas.getBoundingClientRect();
  const column = Math.floor(((event.clientX - box.left) / box.width) * cloud.columns);
  const row = Math.floor(((event.clientY - box.top) / box.height) * cloud.channels);
  const ring = sensor.isRising ? cloud.channels - 1 - row : row;
  for (let point = 0; point < cloud.count; point++) {
    if (cloud.column[point] === column && cloud.ring[point] === ring) {
      mark([{ cloud, at: point }]);
      return;
    }
  }
}

// ---- picking

function placeOf({ cloud, at }) {
  const place = [0, 1, 2].map((axis) => cloud.places[3 * at + axis]);
  const m = matrixFor(cloud.sensor);
  return m ? [0, 1, 2].map((row) => m[row] * place[0] + m[4 + row] * place[1] + m[8 + row] * place[2] + m[12 + row]) : place;
}

function mark(picked) {
  const places = picked.map(placeOf);
  view.setMarks([...places, ...(places.length === 2 ? [places.flat()] : [])]);
  const origin = find("frame").value === "world" ? state.heading.origin_m : [0, 0, 0];
  const words = picked.map(({ cloud, at }, number) => {
    const place = places[number].map((value, axis) => (value + origin[axis]).toFixed(3)).join(" ");
    const value = (name) => cloud[name][at];
    return `${state.sensors[cloud.sensor].name}  ${place} m  range ${(value("range_mm") * 1e-3).toFixed(3)} m\nring ${value("ring")}  column ${value("column")}  ` +
      `${(value("since_ns") * 1e-6).toFixed(3)} ms  return ${value("return_number")}  intensity ${value("intensity")}  reflectivity ${value("reflectivity")}`;
  });
  if (places.length === 2) words.push(`distance ${Math.hypot(...[0, 1, 2].map((axis) => places[0][axis] - places[1][axis])).toFixed(3)} m`);
  find("picked").textContent = words.join("\n");
}

find("cloud").addEventListener("click", (event) => {
  if (view.moved > 4) return;
  const box = find("cloud").getBoundingClientRect();
  const clouds = (state.shown ?? []).map((cloud) => ({ places: cloud.places, ranges: cloud.ranges, matrix: matrixFor(cloud.sensor) }));
  const found = view.pick(event.clientX - box.left, event.clientY - box.top, clouds);
  if (!found) state.picked = [];
  else state.picked = [...(state.picked.length === 1 ? state.picked : []), { cloud: state.shown[found.cloud], at: found.at }];
  mark(state.picked);
});

// ---- controls

function drawBar() {
  const canvas = find("bar");
  const paint = canvas.getContext("2d");
  const bytes = paletteBytes(find("palette").value);
  for (let x = 0; x < canvas.width; x++) {
    const at = 4 * Math.round((255 * x) / (canvas.width - 1));
    paint.fillStyle = `rgb(${bytes[at]} ${bytes[at + 1]} ${bytes[at + 2]})`;
    paint.fillRect(x, 0, 1, canvas.height);
  }
}

function link() {
  const camera = [view.yaw, view.tilt, view.distance, ...view.middle].map((value) => value.toFixed(3)).join(",");
  return `${location.origin}/#time=${state.time.toFixed(3)}&camera=${camera}&colour=${find("colour").value}`;
}

function followLink() {
  const settings = new URLSearchParams(location.hash.slice(1));
  const camera = (settings.get("camera") ?? "").split(",").map(Number);
  if (camera.length === 6 && camera.every(Number.isFinite)) {
    [view.yaw, view.tilt, view.distance] = camera;
    view.middle = camera.slice(3);
  }
  if (settings.get("colour")) find("colour").value = settings.get("colour");
  if (Number(settings.get("time")) > 0) state.time = Number(settings.get("time"));
}

const KEYS = {
  " ": ["play or pause", () => play(!state.isPlaying)],
  ArrowLeft: ["one revolution back (with shift: one second)", (shift) => (shift ? seek(state.time - 1) : step(-1))],
  ArrowRight: ["one revolution on (with shift: one second)", (shift) => (shift ? seek(state.time + 1) : step(1))],
  "[": ["slower", () => { state.speed = Math.max(0, state.speed - 1); say(); }],
  "]": ["faster", () => { state.speed = Math.min(SPEEDS.length - 1, state.speed + 1); say(); }],
  l: ["loop", () => { state.isLooping = !state.isLooping; find("loop").setAttribute("aria-pressed", state.isLooping); }],
  c: ["next colour", () => { find("colour").selectedIndex = (find("colour").selectedIndex + 1) % find("colour").length; recolour(); }],
  o: ["follow the rig", () => { state.isFollowing = !state.isFollowing; state.isInside = view.isInside = false; update(); }],
  i: ["first person: as the rig sees it", () => { state.isInside = !state.isInside; state.isFollowing = false; if (!state.isInside) view.reset(); update(); }],
  "+": ["nearer", () => view.nearer(0.8)],
  "-": ["farther", () => view.nearer(1.25)],
  q: ["turn left", () => view.turn(-0.2, 0)],
  e: ["turn right", () => view.turn(0.2, 0)],
  x: ["axes", () => { view.showAxes = !view.showAxes; press("x", view.showAxes); view.ask(); }],
  m: ["scene", () => { state.isSceneShown = !state.isSceneShown; press("m", state.isSceneShown); update(); }],
  r: ["reset the camera", () => { leave(); view.reset(); state.isFitted = false; if (state.shown?.[0]) fit(state.shown[0]); }],
  t: ["from above", () => { state.isInside = false; view.look(Math.PI, 1.5707); update(); }],
  f: ["from the front", () => { state.isInside = false; view.look(0, 0); update(); }],
  s: ["from the left side", () => { state.isInside = false; view.look(Math.PI / 2, 0); update(); }],
  g: ["range rings, 10 m apart", () => { view.showGrid = !view.showGrid; press("g", view.showGrid); view.ask(); }],
  p: ["screenshot", () => {
    view.draw();
    const name = `view-${state.time.toFixed(2)}s.png`;
    Object.assign(document.createElement("a"), { href: view.canvas.toDataURL("image/png"), download: name }).click();
  }],
  k: ["copy a link with time and camera", () => { history.replaceState(null, "", link()); navigator.clipboard?.writeText(link()); }],
  "?": ["these keys", () => find("help").showModal()],
};

for (const [name, [what]] of Object.entries(KEYS)) {
  const row = document.createElement("tr");
  row.append(element("td", name === " " ? "space" : name), element("td", what));
  find("keys").append(row);
}
find("keys").append(Object.assign(document.createElement("tr"), { innerHTML: "<td>1 to 9</td><td>a sensor on or off</td>" }));

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || find("help").open) return;
  const isTyping = event.target.matches?.("input[type=number], select");
  const number = Number(event.key);
  if (!isTyping && number >= 1 && number <= state.sensors.length) {
    const sensor = state.sensors[number - 1];
    sensor.box.checked = sensor.isOn = !sensor.isOn;
    update();
    return;
  }
  const known = KEYS[event.key];
  if (!known || isTyping || (event.key === " " && event.target.matches?.("button"))) return;
  event.preventDefault();
  known[1](event.shiftKey);
});
for (const button of document.querySelectorAll("button[data-key]")) {
  button.title ||= `${KEYS[button.dataset.key][0]} (${button.dataset.key === " " ? "space" : button.dataset.key})`;
  button.addEventListener("click", (event) => KEYS[button.dataset.key][1](event.shiftKey));
}
for (const button of document.querySelectorAll("button[data-second]")) button.addEventListener("click", () => seek(state.time + Number(button.dataset.second)));
find("colour").addEventListener("change", recolour);
find("palette").addEventListener("change", () => { view.setPalette(find("palette").value); recolour(); });
find("frame").addEventListener("change", forgetAll);
find("returns").addEventListener("change", chooseReturns);
for (const name of ["decay", "least", "most", "image"]) {
  find(name).addEventListener("change", () => {
    find(name).blur(); // the keys are the page's again
    update();
  });
}
find("size").addEventListener("input", () => { view.size = Number(find("size").value); view.ask(); });
for (const [button, code] of [["copy", "command"], ["copy-cut", "cut"]]) find(button).addEventListener("click", () => navigator.clipboard?.writeText(find(code).textContent));
const timeline = find("timeline");
const drag = (event) => {
  if (event.buttons === 0 && event.type !== "pointerdown") return;
  const box = timeline.getBoundingClientRect();
  seek(((event.clientX - box.left) / box.width) * (state.end - state.start));
};
timeline.addEventListener("pointerdown", (event) => { timeline.setPointerCapture(event.pointerId); drag(event); });
timeline.addEventListener("pointermove", drag);
addEventListener("resize", drawTimeline);

followLink();
drawBar();
readIndex();
