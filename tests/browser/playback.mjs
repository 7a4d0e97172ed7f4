// `outrigger view` for a while: first picture, pictures a second of many points, and memory of program and page while a recording
// plays in a loop.
//
//     node tests/browser/playback.mjs OUTRIGGER CHROMIUM RECORDING [META]
//
// PLAY_SECONDS says for how long it plays: 300. `long_vls128.py` makes a recording of 120 MB.
//
// Prints what it measures; exit status 1 where memory grows, pictures come slower than 8 a second while the camera turns
// around 2 million points (without a graphics card), or any of these is missing when it rests.
import { spawn } from "node:child_process";
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const [outrigger, executablePath, recording, meta] = process.argv.slice(2);
const seconds = Number(process.env.PLAY_SECONDS ?? 300);
const MANY = 2_000_000;
const LEAST_PICTURES = 8;
let isFine = true;
function check(name, holds) {
  isFine &&= holds;
  console.log(`${holds ? "ok  " : "FAIL"} ${name}`);
}
const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--js-flags=--expose-gc", "--enable-precise-memory-info"],
});
// a user's browser runs already, and has drawn before
const other = await browser.newPage();
await other.evaluate(() => document.createElement("canvas").getContext("webgl2").finish());
await other.close();
const page = await browser.newPage({ viewport: { width: 1200, height: 800 } });
const start = performance.now();
const child = spawn(outrigger, ["view", recording, ...(meta ? ["--meta", meta] : []), "--no-open"], { stdio: ["ignore", "pipe", "inherit"] });
const url = await new Promise((resolve, reject) => {
  createInterface({ input: child.stdout }).once("line", resolve);
  child.on("exit", (code) => reject(new Error(`view ended with ${code}`)));
});
await page.goto(url, { waitUntil: "commit" });
await page.waitForFunction(() => Number(document.getElementById("cloud")?.dataset.drawn) > 0, null, { timeout: 90_000, polling: 10 });
console.log(`first picture ${((performance.now() - start) / 1000).toFixed(2)} s after the start of the command`);
await page.waitForFunction(() => document.body.dataset.whole, null, { timeout: 600_000 });
console.log(`read to its end ${((performance.now() - start) / 1000).toFixed(1)} s after`);

// turned by hand with so many revolutions in the picture that it has 2 million points
const revolutions = await page.evaluate((many) => {
  const { revolutions } = state.sensors[0];
  const mean = revolutions.reduce((sum, { points }) => sum + points, 0) / revolutions.length;
  const decay = Math.min(revolutions.length, Math.ceil(many / mean) + 1);
  find("decay").value = decay;
  seek(revolutions[decay - 1].host_time_ns[0] * 1e-9 - state.start + 1e-3);
  return decay;
}, MANY);
const isAll = () => page.waitForFunction((revolutions) => state.shown.length === revolutions && view.drawn === state.shown.reduce((sum, { count }) => sum + count, 0), revolutions, { timeout: 120_000 });
await isAll();
const points = await page.evaluate(() => view.drawn);
const box = await page.locator("#cloud").boundingBox();
await page.mouse.move(box.x + 300, box.y + 300);
await page.mouse.down();
const turned = performance.now();
const before = await page.evaluate(() => Number(view.canvas.dataset.frames));
let least = points;
for (let step = 0; performance.now() - turned < 6000; step++) {
  await page.mouse.move(box.x + 300 + 100 * Math.sin(step / 20), box.y + 300);
  if (step % 10 === 9) least = Math.min(least, await page.evaluate(() => view.drawn));
}
const pictures = ((await page.evaluate(() => Number(view.canvas.dataset.frames))) - before) / ((performance.now() - turned) / 1000);
await page.mouse.up();
check(`${pictures.toFixed(1)} pictures a second while the camera turns around ${points} points (at the fewest ${least} of them in a picture)`, points >= MANY && pictures >= LEAST_PICTURES);
await isAll();
check("at rest every point is drawn", (await page.evaluate(() => view.drawn)) === points);
await page.evaluate(() => { find("decay").value = 1; seek(0); });

const memory = async () => {
  const status = readFileSync(`/proc/${child.pid}/status`, "utf8");
  await page.evaluate(() => gc());
  return [Number(status.match(/VmRSS:\s+(\d+)/)[1]) / 1024, (await page.evaluate(() => performance.memory.usedJSHeapSize)) / 2 ** 20];
};
await page.keyboard.press("l");
await page.keyboard.press(" ");
const samples = [];
for (let at = 0; at < seconds; at += 10) {
  await page.waitForTimeout(10_000);
  samples.push(await memory());
}
const words = samples.map(([program, heap]) => `${program.toFixed(0)}+${heap.toFixed(0)}`).join(" ");
console.log(`MiB of program + page, every 10 s: ${words}`);
const most = (part, from, to) => Math.max(...samples.slice(from, to).map((sample) => sample[part]));
const [half, all] = [Math.floor(samples.length / 2), samples.length];
const isFlat = [0, 1].every((part) => most(part, half, all) < 1.1 * most(part, 0, half) + 20);
check(`memory stays while it plays for ${seconds} s`, isFlat && samples.length > 1);
await browser.close();
child.kill("SIGINT");
process.exit(isFine ? 0 : 1);
