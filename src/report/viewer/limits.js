// Which of the points are shown, as the command lines that give just these: `decode` for points, `cut` for their packets.
"use strict";

const sides = (name) => [0, 1, 2].map((axis) => Number(document.querySelector(`#crop [data-${name}="${axis}"]`).value));

// the crop box in the frame that is shown; null without one, or where it holds nothing
function cropBox() {
  if (!find("cropped").checked) return null;
  const [low, high] = [sides("low"), sides("high")];
  if (!low.every((value, axis) => value < high[axis])) return null;
  return { low, high, yaw_deg: Number(find("crop-yaw").value) || 0 };
}

// what the frame that is shown begins at, in that of the files
function origin() {
  return find("frame").value === "world" ? state.heading.origin_m : [0, 0, 0];
}

// the box as the picture has it: 32 bits of the same numbers as the command's
function applyCrop() {
  const box = cropBox();
  view.box = box && {
    middle: box.low.map((value, axis) => (value + box.high[axis]) / 2),
    half: box.low.map((value, axis) => (box.high[axis] - value) / 2),
    yaw: (box.yaw_deg * Math.PI) / 180,
  };
  view.ask();
}

// a first box: the middle half of what is shown
function offerCrop() {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (const cloud of state.shown ?? []) {
    for (let at = 0; at < cloud.count; at += 7) {
      placeOf({ cloud, at }).forEach((value, axis) => {
        low[axis] = Math.min(low[axis], value);
        high[axis] = Math.max(high[axis], value);
      });
    }
  }
  if (!low.every(Number.isFinite)) return;
  low.forEach((value, axis) => {
    const quarter = axis < 2 ? (high[axis] - value) / 4 : 0;
    const round = (number) => Math.round(number * 2) / 2;
    document.querySelector(`#crop [data-low="${axis}"]`).value = round(value + quarter - (axis < 2 ? 0 : 0.5));
    document.querySelector(`#crop [data-high="${axis}"]`).value = round(high[axis] - quarter + (axis < 2 ? 0 : 0.5));
  });
}

function quoted(word) {
  return /^[\w./:@%+=,-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;
}

// revolutions from..to of each sensor that is on
function shownRevolutions() {
  const decay = Math.max(1, Number(find("decay").value) || 1);
  return state.sensors.flatMap((sensor, at) => (sensor.isOn && current(at) >= 0 ? [[at, Math.max(0, current(at) - decay + 1), current(at)]] : []));
}

function decodeCommand() {
  const shown = shownRevolutions();
  const { heading } = state;
  const words = ["outrigger decode", heading.recording_words, heading.source_words];
  const frame = find("frame").value;
  if (frame !== "sensor") words.push(`--frame ${frame}`, heading.mount_words);
  if (frame === "world") words.push(heading.trajectory_words);
  if (shown.length > 0) words.push(`--frames ${Math.min(...shown.map(([, from]) => from))}..${Math.max(...shown.map(([, , to]) => to)) + 1}`);
  words.push(...onlySensors(shown));
  const [least, most] = view.ranges;
  if (least > 0 || most < 1000) words.push(`--range ${least}..${most < 1000 ? most : ""}`);
  const box = cropBox();
  if (box) {
    const corner = (values) => values.map((value, axis) => Number((value + origin()[axis]).toFixed(4)));
    words.push(`--clip=${[...corner(box.low), ...corner(box.high)].join(",")}${box.yaw_deg === 0 ? "" : `@${box.yaw_deg}`}`);
  }
  if (find("returns").value !== "all") words.push(`--returns ${find("returns").value === "1" ? "first" : "second"}`);
  return [...words, "--out points.ply"].filter(Boolean).join(" ");
}

function onlySensors(shown) {
  if (shown.length === state.sensors.length) return [];
  return shown.map(([at]) => `--sensor ${quoted(state.sensors[at].name)}`);
}

// microseconds on either side: a double holds no nanoseconds since 1970
function cutCommand() {
  const shown = shownRevolutions();
  if (shown.length === 0) return "";
  const times = (which, place) => shown.map((row) => state.sensors[row[0]].revolutions[row[place]].host_time_ns[which] / 1e3);
  const from = Math.floor(Math.min(...times(0, 1))) - 1;
  const to = Math.ceil(Math.max(...times(1, 2))) + 1;
  const seconds = (micros) => (micros / 1e6).toFixed(6);
  const words = ["outrigger cut", state.heading.recording_words, state.heading.source_words, `--from ${seconds(from)} --to ${seconds(to)}`, ...onlySensors(shown), "--out part.pcap"];
  return words.filter(Boolean).join(" ");
}

for (const input of document.querySelectorAll("#crop input")) {
  input.addEventListener("change", () => {
    if (input.id === "cropped" && input.checked && !cropBox()) offerCrop();
    input.blur();
    update();
  });
}
