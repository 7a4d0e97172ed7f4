// `outrigger view` for a while: first picture, pictures a second of many points, and memory of program and page while a recording
// plays in a loop.
//
//     node tests/browser/playback.mjs OUTRIGGER CHROMIUM RECORDING [SECONDS] [META]
//
// Prints what it measures; exit status 1 where memory grows.
import { spawn } from "node:child_process";
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const [outrigger, executablePath, recording, seconds = "300", meta] = process.argv.slice(2);
const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--js-flags=--expose-gc", "--enable-precise-memory-info"],
});
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

const memory = async () => {
  const status = readFileSync(`/proc/${child.pid}/status`, "utf8");
  await page.evaluate(() => gc());
  return [Number(status.match(/VmRSS:\s+(\d+)/)[1]) / 1024, (await page.evaluate(() => performance.memory.usedJSHeapSize)) / 2 ** 20];
};
await page.keyboard.press("l");
await page.keyboard.press(" ");
const samples = [];
for (let at = 0; at < Number(seconds); at += 10) {
  await page.waitForTimeout(10_000);
  samples.push(await memory());
}
const words = samples.map(([program, heap]) => `${program.toFixed(0)}+${heap.toFixed(0)}`).join(" ");
console.log(`MiB of program + page, every 10 s: ${words}`);
const most = (part, from, to) => Math.max(...samples.slice(from, to).map((sample) => sample[part]));
const [half, all] = [Math.floor(samples.length / 2), samples.length];
const isFlat = [0, 1].every((part) => most(part, half, all) < 1.1 * most(part, 0, half) + 20);
console.log(`${isFlat ? "ok  " : "FAIL"} memory stays while it plays`);
await browser.close();
child.kill("SIGINT");
process.exit(isFlat ? 0 : 1);
