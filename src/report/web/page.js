// The page: shows each state as it comes, and asks for what its buttons say. Commands are requests, so that each has
// an answer; the stream only tells.
"use strict";

const $ = (id) => document.getElementById(id);
const scene = new Scene($("scene"));
const STALE_MS = 3000;
// what is older than this shows its age
const OLD_MS = 2000;
let last = { at: 0, status: null };
let socket = null;
let wait = 500;

// --- small helpers

function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") element.textContent = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

// changes only what differs: a screen reader does not read the same again, and focus stays
function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function mark(element, ...classes) {
  const name = classes.filter(Boolean).join(" ");
  if (element.className !== name) element.className = name;
}

function facts(list, rows) {
  const known = new Map([...list.querySelectorAll("dt")].map((dt) => [dt.textContent, dt.nextElementSibling]));
  for (const [name, value, kind] of rows) {
    let dd = known.get(name);
    if (!dd) {
      dd = make("dd");
      list.append(make("dt", { text: name }), dd);
    }
    say(dd, value);
    mark(dd, kind);
    known.delete(name);
  }
  for (const dd of known.values()) {
    dd.previousElementSibling.remove();
    dd.remove();
  }
}

const number = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });
const short = new Intl.NumberFormat("en", { notation: "compact", maximumFractionDigits: 1 });
const count = (value) => number.format(value);

function bytes(value) {
  const steps = ["B", "kB", "MB", "GB", "TB"];
  let step = 0;
  while (value >= 1000 && step < steps.length - 1) {
    value /= 1000;
    step += 1;
  }
  return `${value.toFixed(step ? 1 : 0)} ${steps[step]}`;
}

function span(seconds) {
  const s = Math.floor(seconds);
  const two = (value) => String(value).padStart(2, "0");
  return s >= 3600 ? `${Math.floor(s / 3600)}:${two(Math.floor(s / 60) % 60)}:${two(s % 60)}` : `${Math.floor(s / 60)}:${two(s % 60)}`;
}

const degrees = (value) => `${value >= 0 ? "+" : "−"}${Math.abs(value).toFixed(2)}°`;

// --- requests

async function ask(path, body) {
  const response = await fetch(`/api/v1/${path}`, {
    method: "POST",
    headers: body ? { "content-type": "application/json" } : {},
    body: body ? JSON.stringify(body) : undefined,
  });
  const answer = await response.json().catch(() => ({}));
  if (response.status === 401) showLogin();
  if (!response.ok) throw new Error(answer.error ?? `the daemon answers ${response.status}`);
  return answer;
}

async function order(element, words, path, body) {
  mark(element, "answer");
  say(element, `${words} …`);
  try {
    await ask(path, body);
    say(element, `${words}: done.`);
  } catch (error) {
    mark(element, "answer", "bad");
    say(element, `${words}: ${error.message}`);
  }
}

// --- the parts of the page

const STATES = { ok: ["sends", "good"], waiting: ["nothing yet", "bad"], silent: ["silent", "bad"], not_decoded: ["cannot be read", "bad"] };

function showProblems(problems) {
  const list = $("problem-list");
  $("all-well").hidden = problems.length > 0;
  const known = new Map([...list.children].map((item) => [item.dataset.key, item]));
  const times = new Map();
  problems.forEach((problem, at) => {
    const name = `${problem.kind}|${problem.about}`;
    times.set(name, (times.get(name) ?? 0) + 1);
    const key = `${name}|${times.get(name)}`;
    let item = known.get(key);
    if (!item) {
      item = make("li", {}, make("span"), make("b"), make("div"));
      item.dataset.key = key;
    }
    known.delete(key);
    mark(item, problem.severity);
    const [kind, what, advice] = item.children;
    mark(kind, "kind");
    say(kind, problem.severity === "error" ? "trouble" : "look at this");
    say(what, problem.what);
    say(advice, problem.advice);
    if (list.children[at] !== item) list.insertBefore(item, list.children[at] ?? null);
  });
  known.forEach((item) => item.remove());
}

function showSensors(sensors) {
  const list = $("sensor-list");
  sensors.forEach((sensor, at) => {
    let card = list.children[at];
    if (!card) {
      const swatch = make("span", { class: "swatch", "aria-hidden": "true" });
      swatch.style.background = `#${SENSOR_COLOURS[at % SENSOR_COLOURS.length]}`;
      card = make("article", { class: "card" }, make("h3", {}, swatch, make("span"), make("span")), make("p", { class: "hint" }), make("dl", { class: "facts" }));
      list.append(card);
      const legend = make("span", { "aria-hidden": "true" });
      legend.style.background = `#${SENSOR_COLOURS[at % SENSOR_COLOURS.length]}`;
      $("legend").append(make("li", {}, legend, sensor.name));
    }
    const [, name, state] = card.firstElementChild.children;
    say(name, sensor.name);
    const [words, kind] = STATES[sensor.state];
    say(state, words);
    mark(state, "pill", kind);
    say(card.children[1], [sensor.product || sensor.model, sensor.format, sensor.firmware, sensor.serial && `No. ${sensor.serial}`].filter(Boolean).join(" · "));
    const loss = sensor.losses;
    const lost = [
      [loss.kernel_dropped, "in the kernel"], [loss.queue_dropped, "before the disk"], [loss.on_the_way, "in the network"],
      [loss.malformed, "malformed"], [loss.crc_errors, "wrong checksum"], [loss.late, "too late"],
    ].filter(([value]) => value > 0).map(([value, where]) => `${count(value)} ${where}`);
    const odd = [
      [loss.duplicated, "came twice"], [loss.reordered, "out of order"], [loss.foreign_source, "from other senders"],
      [loss.not_its_own, "not its own"], [sensor.restarts, "restarts"],
    ].filter(([value]) => value > 0).map(([value, what]) => `${count(value)} ${what}`);
    const rows = [
      ["Packets", `${count(sensor.packets)}, ${count(sensor.packets_per_s)}/s`],
      ["Points", `${short.format(sensor.points_per_s)}/s`],
      ["Revolutions", `${count(sensor.complete_frames)} of ${count(sensor.frames)} whole${sensor.frame_rate_hz ? `, ${sensor.frame_rate_hz.toFixed(2)}/s` : ""}`],
      ["Lost", lost.length ? lost.join(", ") : "nothing", lost.length ? "bad" : "good"],
    ];
    if (odd.length) rows.push(["Also", odd.join(", "), "warn"]);
    if (sensor.picture_dropped + sensor.frames_not_drawn > 0) rows.push(["Not drawn", `${count(sensor.picture_dropped)} packets, ${count(sensor.frames_not_drawn)} revolutions (they are recorded)`]);
    if (sensor.clock) rows.push(["Clock", clockWords(sensor)]);
    if (sensor.imu_samples) rows.push(["Inertial samples", count(sensor.imu_samples)]);
    if (sensor.position_packets) rows.push(["Position packets", `${count(sensor.position_packets)}${sensor.gps_valid === null ? "" : sensor.gps_valid ? ", GPS valid" : ", no GPS fix"}`]);
    if (sensor.warnings.length) rows.push(["It says", sensor.warnings.join("; "), "bad"]);
    if (sensor.last_packet_age_s * 1000 > OLD_MS) rows.push(["Last packet", `${span(sensor.last_packet_age_s)} ago: all of this is that old`, "bad"]);
    else if (sensor.decoded_age_ms > OLD_MS) rows.push(["Decoded", `${span(sensor.decoded_age_ms / 1000)} ago: what is decoded is that old`, "bad"]);
    rows.push(["Received on", `${sensor.address ?? "?"}${sensor.source ? ` from ${sensor.source}` : ""}`]);
    facts(card.lastElementChild, rows);
  });
}

function clockWords({ clock, timestamp_mode: mode }) {
  const words = {
    utc: "UTC", tai: "TAI by PTP", since_power_on: "counts from power-on, not synchronised", unsynchronised: "not synchronised", unknown: "unknown",
  }[clock.state];
  const offset = clock.state === "utc" ? `${(clock.host_minus_device_s * 1e3).toFixed(2)} ms behind this computer` : `${clock.host_minus_device_s.toFixed(3)} s behind this computer`;
  const drift = clock.drift_ppm === null ? "" : `, drifts ${clock.drift_ppm.toFixed(1)} ppm`;
  if (clock.replays) return `replay: a recording that began again ${clock.replays} times${mode ? ` (${mode})` : ""}`;
  const jumps = clock.jump_count ? `, jumped ${clock.jump_count} times` : "";
  return `${words}, ${offset}${drift}${jumps}${mode ? ` (${mode})` : ""}`;
}

function showRecorder(recorder, timeNs) {
  const pill = $("recording-pill");
  const since = recorder.since_ns === null ? 0 : (timeNs - recorder.since_ns) / 1e9;
  say(pill, recorder.recording ? `recording ${span(since)}` : "not recording");
  mark(pill, "pill", recorder.recording ? "bad" : "quiet");
  const button = $("record");
  say(button, recorder.recording ? "Stop recording" : "Start recording");
  button.dataset.recording = recorder.recording ? "yes" : "";
  $("label").disabled = recorder.recording;
  const rows = [];
  if (recorder.recording) {
    rows.push(["Session", `${recorder.session}${recorder.part > 1 ? ` (part ${recorder.part})` : ""}`]);
    rows.push(["Written", `${count(recorder.packets)} packets, ${bytes(recorder.bytes)}, ${bytes(recorder.bytes_per_s)}/s`]);
    rows.push(["Lost", recorder.session_lost ? `${count(recorder.session_lost)} packets` : "nothing", recorder.session_lost ? "bad" : "good"]);
    if (recorder.latency.count) rows.push(["Delay", `${recorder.latency.p50_ms.toFixed(1)} ms, 99 of 100 below ${recorder.latency.p99_ms.toFixed(1)} ms`]);
  }
  if (recorder.last) {
    const { name, packets, lost, failure, why } = recorder.last;
    rows.push(["Last session", `${name}: ${count(packets)} packets, ${lost ? `${count(lost)} lost` : "nothing lost"}${failure ? `; ${failure}` : why === "disk_full" ? "; ended because the disk was nearly full" : ""}`, lost || failure ? "bad" : ""]);
  }
  if (recorder.free_bytes !== null) {
    const left = recorder.seconds_left === null ? "" : `, ${span(recorder.seconds_left)} at this rate`;
    rows.push(["Disk left", `${bytes(recorder.free_bytes)}${left}`, recorder.low_disk ? "bad" : ""]);
  }
  facts($("recorder-facts"), rows);
}

const SVG = "http://www.w3.org/2000/svg";

function gauge() {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 160 92");
  svg.setAttribute("aria-hidden", "true");
  for (const [tag, attributes] of [
    ["path", { class: "arc", d: "M 10 84 A 70 70 0 0 1 150 84" }],
    ["line", { class: "goal", x1: 80, y1: 84, x2: 80, y2: 16 }],
    ["line", { class: "needle", x1: 80, y1: 84, x2: 80, y2: 24 }],
  ]) {
    const part = document.createElementNS(SVG, tag);
    Object.entries(attributes).forEach(([name, value]) => part.setAttribute(name, value));
    svg.append(part);
  }
  return svg;
}

function showRig(rig) {
  $("rig").hidden = rig === null;
  $("e-stop").hidden = rig === null;
  if (rig === null) return;
  const status = rig.status;
  const armed = rig.connected && status?.armed;
  const words = rig.connected
    ? `${armed ? `Armed${rig.disarms_in_s === null ? "" : `; disarms in ${span(rig.disarms_in_s)} without a command`}` : "Not armed: nothing moves"}${rig.busy ? `. Busy: ${rig.busy}` : ""}.`
    : `Not connected. ${rig.error ?? ""}`;
  say($("rig-state"), words);
  mark($("rig-state"), rig.connected ? (armed ? "warn" : "") : "bad");
  for (const button of document.querySelectorAll("[data-rig]")) {
    const name = button.dataset.rig;
    const moves = "moves" in button.dataset;
    button.disabled = !rig.connected || (moves && (!armed || rig.busy !== null)) || (name === "apply" && rig.mount_pitches_deg.length === 0) || (name === "arm" && armed) || (name === "disarm" && !armed);
  }
  const axes = status?.axes ?? [];
  axes.forEach((axis, at) => {
    let card = $("axes").children[at];
    if (!card) {
      card = make("div", { class: "axis" }, gauge(), make("p", { class: "value" }), make("p"), make("p", { class: "hint" }));
      $("axes").append(card);
    }
    const [svg, value, target, state] = card.children;
    svg.children[1].setAttribute("transform", `rotate(${axis.target_deg} 80 84)`);
    svg.children[2].setAttribute("transform", `rotate(${axis.position_deg} 80 84)`);
    say(value, `Axis ${axis.axis}: ${degrees(axis.position_deg)}`);
    say(target, `target ${degrees(axis.target_deg)}`);
    const faults = [...axis.faults, ...axis.device_errors];
    say(state, [axis.state.replace("_", "-"), axis.homed ? "homed" : "not homed", `angle ${axis.source}${axis.age_ms > OLD_MS ? `, ${span(axis.age_ms / 1000)} old` : ""}`, axis.temperature_c === null ? "" : `${axis.temperature_c} °C`, faults.length ? `FAULT ${faults.join(", ")}` : ""].filter(Boolean).join(", "));
    mark(state, "hint", faults.length ? "bad" : "");
  });
  showPitches(axes, rig.mount_pitches_deg, armed && rig.busy === null);
}

function showPitches(axes, mount, enabled) {
  const form = $("pitches");
  if (form.children.length === 0 && axes.length > 0) {
    axes.forEach((axis, at) => {
      const input = make("input", { type: "number", step: "0.1", required: "", value: (mount[at] ?? axis.position_deg).toFixed(2) });
      form.append(make("label", {}, `Pitch of axis ${axis.axis}, degrees `, input));
    });
    form.append(make("button", { type: "submit", text: "Go there" }));
  }
  const button = form.querySelector("button");
  if (button) button.disabled = !enabled;
}

function showReconfiguration({ reconfiguration, recorder, rig }) {
  if (rig === null) return;
  const { proposal, thinking } = reconfiguration;
  const armed = rig.connected && rig.status?.armed;
  let words = "While recording, the daemon looks for pitches that would see more of the place mapped so far.";
  if (!recorder.recording) words += " It needs a recording that goes on.";
  if (proposal) {
    words = `${proposal.words[0].toUpperCase()}${proposal.words.slice(1)}.`;
    if (proposal.pose === "standing") words += " No trajectory is given: this holds while the platform stands.";
    if (proposal.map_is_full) words += " The map is full: it is of the first part of the recording only.";
    if (proposal.is_better && !armed) words += " Arm the rig to move there.";
  }
  if (thinking) words = "Looking for better pitches …";
  say($("proposal-text"), words);
  $("propose").disabled = !recorder.recording || !rig.connected || thinking;
  const agree = $("agree");
  agree.hidden = !proposal?.is_better;
  agree.disabled = !armed || rig.busy !== null || thinking || !recorder.recording;
  agree.dataset.id = proposal?.id ?? "";
}

function showCoverage(coverage) {
  $("coverage").hidden = !coverage;
  if (!coverage) return;
  const { seen, predicted, seen_of_predicted: confirmed, voxel_m: edge } = coverage;
  const share = predicted ? (100 * confirmed) / predicted : 0;
  const bar = $("coverage-bar");
  bar.hidden = !predicted;
  bar.firstElementChild.style.width = `${share}%`;
  const cells = `cells of ${(edge * 100).toFixed(0)} cm`;
  let words = `${count(seen)} ${cells} seen.`;
  if (predicted) words = `${share.toFixed(1)} % of what is predicted: ${count(confirmed)} of ${count(predicted)} ${cells}; ${count(seen - confirmed)} seen that were not predicted.`;
  else if (coverage.predicting) words += " The prediction is being made.";
  words += ` ${coverage.about}`;
  say($("coverage-text"), words);
  bar.setAttribute("aria-label", words);
  $("cell-legend").hidden = !predicted;
}

function showEvents(events) {
  const list = $("event-list");
  const newest = events.length ? events[events.length - 1].time_ns : 0;
  if (list.dataset.newest === String(newest)) return;
  list.dataset.newest = newest;
  const items = [...events].reverse().map((event) => {
    const time = new Date(event.time_ns / 1e6);
    const words = event.sensor ? `${event.sensor}: ${event.words}` : event.words;
    return make("li", {}, make("time", { datetime: time.toISOString(), text: time.toLocaleTimeString() }), make("span", { text: words }));
  });
  list.replaceChildren(...items);
}

function show(status) {
  last = { at: performance.now(), status };
  document.body.classList.remove("stale");
  const bad = status.problems.some((problem) => problem.severity === "error");
  const words = bad ? "trouble" : status.problems.length ? "look at this" : "all well";
  say($("link"), words);
  mark($("link"), "pill", bad ? "bad" : status.problems.length ? "" : "good");
  document.title = `${bad ? "⚠ " : ""}${status.recorder.recording ? "● " : ""}Outrigger`;
  showProblems(status.problems);
  showSensors(status.sensors);
  showRecorder(status.recorder, status.time_ns);
  showRig(status.rig);
  showReconfiguration(status);
  showCoverage(status.coverage);
  showEvents(status.events);
}

// --- the stream

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/v1/stream`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = (event) => {
    wait = 500;
    if (typeof event.data === "string") show(JSON.parse(event.data).status);
    else takePicture(event.data);
  };
  socket.onclose = async () => {
    lost();
    // a refusal looks like any other end here: ask why
    const probe = await fetch("/api/v1/status").catch(() => null);
    if (probe?.status === 401) return showLogin();
    setTimeout(connect, wait);
    wait = Math.min(wait * 1.6, 5000);
  };
}

function lost() {
  document.body.classList.add("stale");
  say($("link"), "no connection to the daemon; trying again");
  $("all-well").hidden = true; // of a state that is past
  mark($("link"), "pill", "bad");
}

let described = 0;
function takePicture(message) {
  const { kind } = scene.take(message);
  if (kind !== POINTS_KIND || performance.now() - described < 2000) return;
  described = performance.now();
  say($("scene-text"), scene.gl ? `${count(scene.drawn)} points and cells drawn.` : "This browser draws no WebGL 2: the numbers below are all there is.");
}

setInterval(() => {
  if (last.at > 0 && performance.now() - last.at > STALE_MS) lost();
}, 1000);

// --- the token

function showLogin() {
  if (!$("login").open) $("login").showModal();
}

$("login-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  try {
    await ask("login", { token: $("token").value });
    $("login").close();
    $("token").value = "";
    connect();
  } catch (error) {
    say($("login-answer"), error.message);
  }
});

// --- buttons

$("record").addEventListener("click", () => {
  const recording = $("record").dataset.recording === "yes";
  const answer = $("recorder-answer");
  if (recording) order(answer, "Stop recording", "recording/stop");
  else order(answer, "Start recording", "recording/start", { label: $("label").value });
});

const RIG_WORDS = { arm: "Arm", disarm: "Disarm", home: "Home", apply: "Apply the mount", hold: "Hold", clear: "Clear faults" };
for (const button of document.querySelectorAll("[data-rig]")) {
  const name = button.dataset.rig;
  button.addEventListener("click", () => order($("rig-answer"), RIG_WORDS[name], `rig/${name}`));
}

// asks again until it is answered: the one button that may not get lost
$("e-stop").addEventListener("click", async () => {
  const answer = $("rig-answer");
  for (let attempt = 0; attempt < 5; attempt++) {
    await order(answer, "Emergency stop", "rig/e-stop");
    if (!answer.classList.contains("bad")) return;
    await new Promise((done) => setTimeout(done, 300));
  }
});

$("propose").addEventListener("click", () => order($("rig-answer"), "Propose better pitches", "reconfiguration/propose"));
$("agree").addEventListener("click", () => order($("rig-answer"), "Move to the proposed pitches", "reconfiguration/agree", { id: Number($("agree").dataset.id) }));

$("pitches").addEventListener("submit", (event) => {
  event.preventDefault();
  const pitches = [...$("pitches").querySelectorAll("input")].map((input) => Number(input.value));
  order($("rig-answer"), "Go there", "rig/apply", { pitches_deg: pitches });
});

$("show-points").addEventListener("change", (event) => {
  scene.showPoints = event.target.checked;
  scene.ask();
});
$("show-cells").addEventListener("change", (event) => {
  scene.showCells = event.target.checked;
  scene.ask();
});
$("view-reset").addEventListener("click", () => scene.fitAll());
$("freeze").addEventListener("click", (event) => {
  scene.isFrozen = !scene.isFrozen;
  event.target.setAttribute("aria-pressed", scene.isFrozen);
  event.target.textContent = scene.isFrozen ? "Go on" : "Freeze";
});
$("colour-by").addEventListener("change", (event) => scene.colourBy(event.target.value));
for (const name of ["ring-from", "ring-to"]) $(name).addEventListener("change", () => scene.showRings(Number($("ring-from").value), Number($("ring-to").value)));
for (const [name, act] of Object.entries({ "view-top": () => scene.look(Math.PI, 1.5707), "view-nearer": () => scene.nearer(0.8), "view-farther": () => scene.nearer(1.25), "view-left": () => scene.turn(0.3, 0), "view-right": () => scene.turn(-0.3, 0) })) {
  $(name).addEventListener("click", act);
}

const cellLegend = make("ul", { class: "legend", id: "cell-legend", hidden: "" });
["predicted, not seen yet", "predicted and seen", "seen, not predicted"].forEach((words, state) => {
  const swatch = make("span", { class: "square", "aria-hidden": "true" });
  swatch.style.background = `#${CELL_COLOURS[state]}`;
  cellLegend.append(make("li", {}, swatch, words));
});
$("layers").after(cellLegend);

connect();
