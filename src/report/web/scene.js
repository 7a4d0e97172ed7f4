// The live view: the newest points of each sensor and the cells of the coverage, in the program's one viewer (cloud.js). The
// layout of the messages stands in src/daemon/picture.rs.
"use strict";

const POINTS_KIND = 1;
const CELLS_KIND = 2;
const HEADER_BYTES = 32;
// revolutions of a sensor that stay on the picture
const MAX_REVOLUTIONS = 15;
// predicted and unseen, predicted and seen, seen and not predicted
const CELL_COLOURS = ["d55e00", "009e73", "cc79a7"];
const CELL_ALPHA = [0.75, 0.3, 0.3];

class Scene extends CloudView {
  constructor(canvas) {
    super(canvas);
    Object.assign(this, { showPoints: true, showCells: true, isFrozen: false, isPolite: true, colour: "sensor", rings: [0, 255], fitted: false });
    Object.assign(this, { clouds: new Map(), cells: [], drawn: 0, size: 2, limits: [0, 255] });
    if (!this.gl) return;
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

  // takes a message of the stream; the kernel's stamp of points, UTC ns
  take(message) {
    const head = new DataView(message, 0, HEADER_BYTES);
    const [kind, sensor, count] = [head.getUint8(0), head.getUint8(1), head.getUint32(4, true)];
    const origin = [16, 20, 24].map((at) => head.getFloat32(at, true));
    const metres = head.getFloat32(28, true);
    if (this.gl && !this.isFrozen) {
      if (kind === POINTS_KIND) this.takePoints({ origin, metres, count, sensor }, message);
      if (kind === CELLS_KIND) this.takeCells({ origin, metres, count }, message);
      this.ask();
    }
    return { kind, sensor, count, timeNs: head.getBigUint64(8, true) };
  }

  // counts to metres, from an origin
  matrixOf(origin, metres) {
    return new Float32Array([metres, 0, 0, 0, 0, metres, 0, 0, 0, 0, metres, 0, ...origin, 1]);
  }

  takePoints({ origin, metres, count, sensor }, message) {
    const [counts, bytes] = [new Int16Array(message, HEADER_BYTES), new Uint8Array(message, HEADER_BYTES)];
    const places = new Int16Array(3 * count);
    const part = { origin, metres, count, sensor, places, reflectivity: new Uint8Array(count), rings: new Uint8Array(count), matrix: this.matrixOf(origin, metres) };
    for (let at = 0; at < count; at++) {
      places.set(counts.subarray(4 * at, 4 * at + 3), 3 * at);
      part.reflectivity[at] = bytes[8 * at + 6];
      part.rings[at] = bytes[8 * at + 7];
    }
    part.cloud = this.uploadPoints(places, this.valuesOf(part), part.rings);
    const cloud = this.clouds.get(sensor) ?? [];
    cloud.push(part);
    while (cloud.length > MAX_REVOLUTIONS) this.free(cloud.shift().cloud);
    this.clouds.set(sensor, cloud);
    if (!this.fitted && this.cells.length === 0) this.fitTo(places, part);
  }

  takeCells({ origin, metres, count }, message) {
    const [counts, bytes] = [new Uint16Array(message, HEADER_BYTES), new Uint8Array(message, HEADER_BYTES)];
    const by = CELL_COLOURS.map(() => []);
    for (let at = 0; at < count; at++) by[bytes[8 * at + 6]].push(counts[4 * at], counts[4 * at + 1], counts[4 * at + 2]);
    this.cells.forEach(({ part }) => this.free(part));
    const middle = origin.map((value) => value + metres / 2);
    this.cells = by.map((places, state) => ({
      part: this.uploadPoints(new Uint16Array(places)), matrix: this.matrixOf(middle, metres), metres, isWhole: true,
      colour: [...rgb(CELL_COLOURS[state]), CELL_ALPHA[state]],
    }));
    if (!this.fitted && count > 0) this.fitTo(Uint16Array.from(by.flat()), { origin: middle, metres, count });
  }

  valuesOf(part) {
    if (this.colour === "height") return Float32Array.from({ length: part.count }, (_, at) => part.origin[2] + part.places[3 * at + 2] * part.metres);
    return Float32Array.from(this.colour === "ring" ? part.rings : part.reflectivity);
  }

  colourBy(name) {
    this.colour = name;
    for (const cloud of this.clouds.values()) cloud.forEach((part) => this.setRow(part.cloud, 1, this.valuesOf(part)));
    this.ask();
  }

  showRings(from, to) {
    this.rings = [from, to];
    this.ask();
  }

  // minimum and maximum of what is on the picture
  spread() {
    let [low, high] = [Infinity, -Infinity];
    for (const cloud of this.clouds.values()) {
      for (const value of this.valuesOf(cloud.at(-1))) [low, high] = [Math.min(low, value), Math.max(high, value)];
    }
    return low < high ? [low, high] : [0, 1];
  }

  // points lie on top of the cells, the newest brightest
  draw() {
    const items = this.showCells ? [...this.cells] : [];
    if (this.showPoints) {
      if (this.colour !== "sensor") this.limits = this.spread();
      for (const [sensor, cloud] of this.clouds) {
        cloud.forEach((part, at) => {
          const age = (at + 1 + MAX_REVOLUTIONS - cloud.length) / MAX_REVOLUTIONS;
          const colour = this.colour === "sensor" ? [...rgb(SENSOR_COLOURS[sensor % SENSOR_COLOURS.length]), age] : null;
          items.push({ part: part.cloud, matrix: part.matrix, colour, ranges: this.rings });
        });
      }
    }
    this.shown = items;
    this.ground = getComputedStyle(this.canvas).backgroundColor.match(/[\d.]+/g).slice(0, 3).map((value) => Number(value) / 255);
    super.draw();
  }

  // looks at all of a part
  fitTo(places, { origin, metres, count }) {
    if (count === 0) return;
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (let at = 0; at < count; at++) {
      for (let axis = 0; axis < 3; axis++) {
        const value = origin[axis] + places[3 * at + axis] * metres;
        low[axis] = Math.min(low[axis], value);
        high[axis] = Math.max(high[axis], value);
      }
    }
    this.fit(low, high);
    this.fitted = true;
  }

  fitAll() {
    this.fitted = false;
    this.reset();
    const all = [...this.clouds.values()].map((cloud) => cloud.at(-1)).filter(Boolean);
    if (this.cells.length === 0 && all[0]) this.fitTo(all[0].places, all[0]);
    else this.fitted = true;
  }
}
