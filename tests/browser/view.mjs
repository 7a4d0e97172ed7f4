// `outrigger view` in a real browser: plays, steps, colours, picks; what it shows is what `decode` writes.
//
//     node tests/browser/view.mjs OUTRIGGER CHROMIUM CAPTURE [META] [FOLDER_FOR_SCREENSHOTS]
//
// Ends with `N passed, N failed`; exit status 1 when a check failed.
import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";
import { seriousFaults } from "./accessible.mjs";

const [outrigger, executablePath, capture, meta, shots] = process.argv.slice(2);
const folder = mkdtempSync(join(tmpdir(), "outrigger-view-"));
const metas = meta ? ["--meta", meta] : [];
const PATIENCE = { timeout: 90_000 };
let [passed, failed] = [0, 0];

function check(name, holds, detail = "") {
  if (holds) passed += 1;
  else failed += 1;
  console.log(`${holds ? "ok  " : "FAIL"} ${name}${holds ? "" : ` ${detail}`}`);
}

const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"],
});
const page = await browser.newPage({ viewport: { width: 1200, height: 800 } });
// a user's browser runs already: the time is that of the command
const started = performance.now();
const child = spawn(outrigger, ["view", capture, ...metas, "--no-open"], { stdio: ["ignore", "pipe", "inherit"] });
const url = await new Promise((resolve, reject) => {
  createInterface({ input: child.stdout }).once("line", resolve);
  child.on("exit", (code) => reject(new Error(`view ended with ${code}`)));
});
const [errors, outside] = [[], []];
page.on("pageerror", (error) => errors.push(error.message));
page.on("request", (request) => {
  if (!request.url().startsWith(url) && !request.url().startsWith("data:") && !request.url().startsWith("blob:")) outside.push(request.url());
});
await page.goto(url);
await page.waitForFunction(() => Number(document.getElementById("cloud").dataset.drawn) > 0, null, PATIENCE);
console.log(`first picture ${((performance.now() - started) / 1000).toFixed(2)} s after the start of the command`);
await page.waitForFunction(() => document.body.dataset.whole === "1", null, PATIENCE);

const pixels = () => page.evaluate(() => {
  view.draw();
  const gl = view.gl;
  const bytes = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
  gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  return bytes.reduce((sum, byte, at) => (sum * 31 + byte * ((at % 251) + 1)) % 2147483647, 7);
});
// a colour field that is the same everywhere in this recording may paint as another one does
const seen = new Set();
const colours = await page.locator("#colour option").evaluateAll((options) => options.map((option) => option.value));
for (const colour of colours) {
  await page.selectOption("#colour", colour);
  seen.add(await pixels());
}
check("the colour follows the field", seen.size >= colours.length - 3, `${seen.size} pictures of ${colours.length}`);
await page.selectOption("#colour", "height");

const revolution = async () => Number((await page.textContent("#time")).match(/revolution (\d+)/)[1]);
await page.keyboard.press("ArrowRight");
check("an arrow steps a revolution", (await revolution()) === 1, await page.textContent("#time"));
await page.keyboard.press("ArrowLeft");
check("and back", (await revolution()) === 0, await page.textContent("#time"));

const csv = join(folder, "points.csv");
execFileSync(outrigger, ["decode", capture, ...metas, "--frames", "0..1", "--out", csv], { stdio: "ignore" });
const [head, ...rows] = readFileSync(csv, "utf8").trim().split("\n").map((row) => row.split(","));
const column = Object.fromEntries(head.map((name, at) => [name, at]));
await page.waitForFunction(() => state.shown?.[0]?.revolution === 0, null, PATIENCE);
check("as many points as decode writes", (await page.evaluate(() => state.shown[0].count)) === rows.length);
const target = await page.evaluate(() => {
  // a pixel with a point under it, near the middle of the picture
  const cloud = state.shown[0];
  for (let apart = 0; apart < 300; apart += 3) {
    for (const [x, y] of [[500 + apart, 300], [500, 300 + apart], [500 - apart, 300], [500, 300 - apart / 2]]) {
      if (view.pick(x, y, [{ places: cloud.places, ranges: cloud.ranges, matrix: null }])) return [x, y];
    }
  }
  return null;
});
const box = await page.locator("#cloud").boundingBox();
await page.mouse.click(box.x + target[0], box.y + target[1]);
const picked = await page.textContent("#picked");
const [, x, y, z, range, ring, col, number] = picked.match(/ (-?[\d.]+) (-?[\d.]+) (-?[\d.]+) m  range ([\d.]+) m\s+ring (\d+)  column (\d+).*return (\d)/) ?? [];
const row = rows.find((row) => row[column.ring] === ring && row[column.column] === col && row[column.return_number] === number);
const isNear = (name, value) => Math.abs(Number(row?.[column[name]]) - Number(value)) < 0.002;
check("a picked point has the values of decode",
  row && Number(row[column.range_mm]) === Math.round(Number(range) * 1000) && isNear("x_m", x) && isNear("y_m", y) && isNear("z_m", z),
  `${picked} ${row}`);

const command = await page.textContent("#command");
const ply = join(folder, "points.ply");
execFileSync("bash", ["-c", command.replace("outrigger ", `${outrigger} `).replace("points.ply", ply)], { stdio: "ignore" });
const count = Number(readFileSync(ply, "latin1").match(/element vertex (\d+)/)[1]);
check("the command on the page gives the same points", count === rows.length, command);

await page.locator("#most").fill("5");
await page.locator("#most").dispatchEvent("change");
const near = await pixels();
await page.locator("#most").fill("1000");
await page.locator("#most").dispatchEvent("change");
check("a range limit hides points", near !== (await pixels()));

// a crop box: the points in it, counted here, and by the command line that the page shows
await page.locator("#cropped").check();
const low = [-40, -30, -3];
const high = [50, 45.5, 8.25];
for (const axis of [0, 1, 2]) {
  await page.locator(`#crop [data-low="${axis}"]`).fill(String(low[axis]));
  await page.locator(`#crop [data-high="${axis}"]`).fill(String(high[axis]));
}
await page.locator("#crop-yaw").fill("20");
await page.locator("#crop-yaw").dispatchEvent("change");
const cropped = await pixels();
const inside = (row) => {
  const off = ["x_m", "y_m", "z_m"].map((name, axis) => Number(row[column[name]]) - (low[axis] + high[axis]) / 2);
  const [cos, sin] = [Math.cos(Math.PI / 9), Math.sin(Math.PI / 9)];
  const turned = [cos * off[0] + sin * off[1], cos * off[1] - sin * off[0], off[2]];
  return turned.every((value, axis) => Math.abs(value) <= (high[axis] - low[axis]) / 2);
};
const expected = rows.filter(inside).length;
const counted = await page.evaluate(() => {
  const [cloud] = state.shown;
  let count = 0;
  for (let at = 0; at < cloud.count; at++) count += view.isInBox(cloud.places[3 * at], cloud.places[3 * at + 1], cloud.places[3 * at + 2], null);
  return count;
});
check("the crop box hides points", expected > 100 && expected < rows.length && counted === expected, `${counted}, expected ${expected} of ${rows.length}`);
const clip = await page.textContent("#command");
check("and stands in the command line", clip.includes("--clip=-40,-30,-3,50,45.5,8.25@20"), clip);
if (execFileSync(outrigger, ["decode", "--help"], { encoding: "utf8" }).includes("--clip")) {
  const part = join(folder, "part.ply");
  execFileSync("bash", ["-c", clip.replace("outrigger ", `${outrigger} `).replace("points.ply", part)], { stdio: "ignore" });
  const found = Number(readFileSync(part, "latin1").match(/element vertex (\d+)/)[1]);
  check("which gives the same points", found === expected, `${found}, expected ${expected}: ${clip}`);
} else {
  console.log("LEFT OUT: the command line with a crop box (this decode has no --clip)");
}
await page.locator("#cropped").uncheck();
check("without the box all points are back", cropped !== (await pixels()));

// the packets of what is shown, as a recording of their own
const cut = await page.textContent("#cut");
const part = join(folder, "part.pcap");
execFileSync("bash", ["-c", cut.replace("outrigger ", `${outrigger} `).replace("part.pcap", part)], { stdio: "ignore" });
const again = join(folder, "again.csv");
execFileSync(outrigger, ["decode", part, ...metas, "--out", again], { stdio: "ignore" });
check("the cut holds the revolution's packets", readFileSync(again, "utf8").trim().split("\n").length - 1 >= rows.length, cut);

// cameras
const orbit = await pixels();
for (const [name, what] of [["First person", "first person"], ["Top", "from above"], ["Reset", "reset"]]) {
  await page.getByRole("button", { name, exact: true }).click();
  const seen = await pixels();
  check(`a button shows it ${what}`, what === "reset" ? seen === orbit : seen !== orbit);
}
for (const key of ["g", "x"]) await page.keyboard.press(key);
check("rings and axes can be left out", (await pixels()) !== orbit);

await page.locator("#cloud").focus();
await page.keyboard.press(" ");
await page.waitForFunction(() => state.time > 0.15 || !state.isPlaying, null, PATIENCE);
check("it plays", (await page.evaluate(() => state.time)) > 0.1);
await page.keyboard.press("?");
check("? lists the keys", await page.locator("#help").isVisible());
await page.locator("#help button").click();
if (shots) {
  await page.screenshot({ path: join(shots, "view.png") });
  await page.emulateMedia({ colorScheme: "dark" });
  await page.setViewportSize({ width: 390, height: 800 });
  await page.screenshot({ path: join(shots, "view-phone-dark.png") });
}
const faults = await seriousFaults(page);
check("axe-core finds no serious fault", faults.length === 0, faults.join("\n     "));
// while the camera moves a slow machine draws a part, and at rest all of it
const all = await page.evaluate(() => state.shown.reduce((sum, { count }) => sum + count, 0));
const moving = await page.evaluate(() => {
  view.budget = LEAST_BUDGET;
  view.turn(0.1, 0);
  view.draw();
  return view.drawn;
});
check("a part of the points is drawn while the camera moves", moving > 0 && moving < 0.5 * all, `${moving} of ${all}`);
await page.waitForFunction((all) => view.drawn === all, all, { timeout: 10_000 }).catch(() => {});
check("at rest every point is drawn", (await page.evaluate(() => view.drawn)) === all, `${await page.evaluate(() => view.drawn)} of ${all}`);
// 26214: its step of the golden section shares divisors with it and its neighbours
const widest = await page.evaluate(() => {
  const counts = [1, 2, 1000, 26214, 32768, 46368, state.shown[0].count];
  return counts.map((count) => {
    const numbers = mixed(Float64Array.from({ length: count }, (_, at) => at), 1);
    if (new Set(numbers).size !== count) return [count, Infinity];
    const tenth = [...numbers.slice(0, Math.floor(count / 10))].sort((a, b) => a - b);
    return [count, Math.max(0, ...tenth.slice(1).map((number, at) => number - tenth[at]))];
  });
});
check("the part is an even sample: a tenth leaves no gap of 40 points", widest.every(([, gap]) => gap < 40), JSON.stringify(widest));
check("no request leaves the page", outside.length === 0, outside.join(" "));
check("no error on the page", errors.length === 0, errors.join(" "));
await browser.close();
const code = await new Promise((resolve) => {
  child.on("exit", resolve);
  child.kill("SIGINT");
});
check("Ctrl-C ends it in order", code === 0, `${code}`);
rmSync(folder, { recursive: true, force: true });
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed === 0 ? 0 : 1);
