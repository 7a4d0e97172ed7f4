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

const child = spawn(outrigger, ["view", capture, ...metas, "--no-open"], { stdio: ["ignore", "pipe", "inherit"] });
const started = performance.now();
const url = await new Promise((resolve, reject) => {
  createInterface({ input: child.stdout }).once("line", resolve);
  child.on("exit", (code) => reject(new Error(`view ended with ${code}`)));
});
const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"],
});
const page = await browser.newPage({ viewport: { width: 1200, height: 800 } });
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
execFileSync("bash", ["-c", command.replace("outrigger ", `${outrigger} `).replace("points.ply", ply) + metas.map((word) => ` '${word}'`).join("")], { stdio: "ignore" });
const count = Number(readFileSync(ply, "latin1").match(/element vertex (\d+)/)[1]);
check("the command on the page gives the same points", count === rows.length, command);

await page.locator("#most").fill("5");
await page.locator("#most").dispatchEvent("change");
const near = await pixels();
await page.locator("#most").fill("1000");
await page.locator("#most").dispatchEvent("change");
check("a range limit hides points", near !== (await pixels()));

await page.keyboard.press(" ");
await page.waitForFunction(() => state.time > 0.15 || !state.isPlaying, null, PATIENCE);
check("it plays", (await page.evaluate(() => state.time)) > 0.1);
await page.keyboard.press("?");
check("? lists the keys", await page.locator("#help").isVisible());
if (shots) {
  await page.locator("#help button").click();
  await page.screenshot({ path: join(shots, "view.png") });
  await page.emulateMedia({ colorScheme: "dark" });
  await page.setViewportSize({ width: 390, height: 800 });
  await page.screenshot({ path: join(shots, "view-phone-dark.png") });
}
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
