// The 3-D pictures of a report: each figure's data become layers of the viewer, with a switch and a button for everything.
"use strict";

const LIST = { Points: "points", Lines: "lines", Surface: "surface" };

class Orbit {
  constructor(figure) {
    this.figure = figure;
    this.data = JSON.parse(figure.querySelector("script").textContent);
    this.stage = figure.querySelector(".stage");
    this.picture = this.stage.querySelector("svg");
    const canvas = document.createElement("canvas");
    Object.assign(canvas, { tabIndex: 0 });
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${this.data.label}, in 3-D. Drag to turn, shift and drag to move, wheel to come nearer; the buttons below do the same.`);
    this.view = new CloudView(canvas);
    if (!this.view.gl) return; // the picture stays
    this.stage.append(canvas);
    figure.classList.add("is-live");
    this.view.isPolite = true;
    this.unpack();
    this.addControls();
    this.paint();
    this.home();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paint());
  }

  unpack() {
    const { middle_m: middle, count_m: count } = this.data;
    this.matrix = new Float32Array([count, 0, 0, 0, 0, count, 0, 0, 0, 0, count, 0, ...middle, 1]);
    for (const layer of this.data.layers) {
      const bytes = Uint8Array.from(atob(layer.places), (letter) => letter.charCodeAt(0));
      const upload = layer.shape === LIST.Points ? "uploadPoints" : "upload";
      layer.part = this.view[upload](new Int16Array(bytes.buffer));
      delete layer.places;
    }
    this.view.top = this.data.cut_m;
    this.view.showGrid = false;
  }

  // colours are the page's, which follow light and dark
  paint() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => rgb(style.getPropertyValue(`--${name}`).trim().slice(1));
    const gl = this.view.gl;
    this.view.ground = colour("scene");
    this.view.show(this.data.layers.filter((layer) => layer.is_shown).map((layer) => ({
      part: layer.part, matrix: this.matrix, isWhole: !layer.is_cut, metres: 1.4 * layer.size_m, isShaded: layer.shape === LIST.Surface, size: 2,
      colour: colour(layer.colour), kind: { [LIST.Points]: gl.POINTS, [LIST.Lines]: gl.LINES, [LIST.Surface]: gl.TRIANGLES }[layer.shape],
    })));
  }

  home() {
    this.view.home = { ...this.view.home, yaw: 3.7, tilt: 0.85 };
    const [low, high] = this.data.bounds_m;
    this.view.fit(low, [high[0], high[1], this.data.cut_m]);
  }

  // at a place of an extent
  lookAt([x, y, z, size]) {
    const { view } = this;
    Object.assign(view, { middle: [x, y, z], distance: Math.max(3, 4 * size), isInside: false });
    const arm = Math.max(0.3, size / 2);
    view.setMarks([[x - arm, y, z, x + arm, y, z, x, y - arm, z, x, y + arm, z, x, y, z - arm, x, y, z + arm]]);
    view.top = Math.max(view.top, z + arm);
    this.cut.value = view.top;
    this.stage.scrollIntoView({ block: "nearest" });
    view.canvas.focus({ preventScroll: true });
  }

  // to the pose at this share of the trajectory, as a person sees it
  stand(share) {
    const { poses } = this.data;
    const [x, y, z, heading] = poses[Math.round(share * (poses.length - 1))];
    this.view.enter([x, y, z + 0.05], heading);
    this.view.top = 1e9;
  }

  addControls() {
    const { view, data } = this;
    const bar = document.createElement("div");
    bar.className = "buttons";
    const button = (words, act) => {
      const made = Object.assign(document.createElement("button"), { type: "button", textContent: words });
      made.addEventListener("click", act);
      bar.append(made);
    };
    button("Reset", () => { view.top = data.cut_m; this.cut.value = data.cut_m; view.setMarks([]); view.reset(); });
    button("Top", () => view.look(Math.PI, 1.5707));
    button("Front", () => view.look(0, 0));
    button("Side", () => view.look(Math.PI / 2, 0));
    button("Nearer", () => view.nearer(0.8));
    button("Farther", () => view.nearer(1.25));
    button("Turn left", () => view.turn(-0.3, 0));
    button("Turn right", () => view.turn(0.3, 0));
    button("Picture as PNG", () => {
      view.draw();
      Object.assign(document.createElement("a"), { href: view.canvas.toDataURL("image/png"), download: "view.png" }).click();
    });
    const slider = (words, attributes, act) => {
      const label = document.createElement("label");
      const input = Object.assign(document.createElement("input"), { type: "range", ...attributes });
      input.addEventListener("input", () => act(Number(input.value)));
      label.append(`${words} `, input);
      bar.append(label);
      return input;
    };
    const [low, high] = [data.bounds_m[0][2], data.bounds_m[1][2]];
    this.cut = slider("Cut above", { min: low, max: high + 0.1, step: (high - low) / 200 || 0.01, value: data.cut_m }, (value) => { view.top = value; view.ask(); });
    if (data.poses.length > 1) slider("Stand on the path", { min: 0, max: 1, step: 0.002, value: 0 }, (value) => this.stand(value));
    const layers = document.createElement("fieldset");
    layers.append(Object.assign(document.createElement("legend"), { textContent: "Shown" }));
    for (const layer of data.layers) {
      const label = document.createElement("label");
      const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: layer.is_shown });
      box.addEventListener("change", () => { layer.is_shown = box.checked; this.paint(); });
      const swatch = Object.assign(document.createElement("span"), { className: "swatch" });
      swatch.style.background = `var(--${layer.colour})`;
      label.append(box, swatch, layer.name);
      layers.append(label);
    }
    this.stage.after(bar, layers);
    view.canvas.addEventListener("keydown", (event) => {
      const keys = { ArrowLeft: () => view.turn(0.1, 0), ArrowRight: () => view.turn(-0.1, 0), ArrowUp: () => view.turn(0, 0.1), ArrowDown: () => view.turn(0, -0.1),
        "+": () => view.nearer(0.85), "-": () => view.nearer(1.18), r: () => view.reset() };
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
    });
  }
}

const orbits = [...document.querySelectorAll("figure.orbit")].map((figure) => new Orbit(figure));
document.addEventListener("click", (event) => {
  const place = event.target.closest?.("[data-look]");
  const orbit = place && orbits.find((orbit) => orbit.figure.contains(place));
  if (orbit?.view.gl) orbit.lookAt(place.dataset.look.split(",").map(Number));
});
