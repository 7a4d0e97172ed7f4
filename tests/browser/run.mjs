// The daemon's page in a real browser: draws, steers, speaks up, comes back.
//
//     node tests/browser/run.mjs OUTRIGGER CHROMIUM [FOLDER_FOR_SCREENSHOTS]
//
// Ends with `N passed, N failed`; exit status 1 when a check failed.
import { spawn } from "node:child_process";
import { existsSync, mkdtempSync, rmSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";
import { seriousFaults } from "./accessible.mjs";

const [outrigger, executablePath, shots] = process.argv.slice(2);
const folder = mkdtempSync(join(tmpdir(), "outrigger-page-"));
const children = new Set();
const PATIENCE = 60_000;
let [passed, failed] = [0, 0];

function check(name, holds, detail = "") {
  if (holds) passed += 1;
  else failed += 1;
  console.log(`${holds ? "ok  " : "FAIL"} ${name}${holds ? "" : ` ${detail}`}`);
}

// starts a program; resolves with its first lines once they satisfy `ready`
function start(args, ready) {
  const child = spawn(outrigger, args, { cwd: folder, stdio: ["ignore", "pipe", "inherit"] });
  children.add(child);
  child.on("exit", () => children.delete(child));
  const lines = createInterface({ input: child.stdout });
  return new Promise((resolve, reject) => {
    let text = "";
    lines.on("line", (line) => {
      text += line;
      const found = ready(text);
      if (found) resolve({ child, found });
    });
    child.on("exit", (code) => reject(new Error(`outrigger ${args.join(" ")} ended with ${code}`)));
  });
}

const json = (text) => {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
};
const end = (child, signal = "SIGTERM") => new Promise((resolve) => {
  child.on("exit", resolve);
  child.kill(signal);
});

const mount = (name, model, x_m, pitch_deg) => ({ name, model, x_m, y_m: 0, z_m: 0.1, pitch_deg, roll_deg: 0 });
const sensorArgs = {
  left: (to) => ["--json", "mock", "sensor", "--model", "os1-16", "--columns", "512", "--serial", "992200000001", "--to", to, "--box=-6,-4,-1.5,6,4,2", "--mount=-0.2,0,0.1,-12,0"],
  right: (to) => ["--json", "mock", "sensor", "--model", "vlp-16", "--to", to, "--box=-6,-4,-1.5,6,4,2", "--mount=0.2,0,0.1,12,0"],
};

async function daemon(listen) {
  const { child, found } = await start(["--json", "daemon", "--config", "rig.toml", "--listen", listen, "--stop-below-mib", "1", "--warn-below-mib", "1"], json);
  return { child, url: found.url, to: Object.fromEntries(found.sensors.map((sensor) => [sensor.name, sensor.address])) };
}

async function main() {
  const rig = await start(["--json", "mock", "rig"], json);
  symlinkSync(rig.found.port, join(folder, "rig"));
  writeFileSync(join(folder, "mount.json"), JSON.stringify({
    format: "outrigger-mount/1", frame: "mount: x right, y forward, z up",
    sensors: [mount("left", "os1-16", -0.2, -12), mount("right", "vlp-16", 0.2, 12)],
  }));
  // metadata come from the mock sensor: one that sends nowhere writes them
  const writer = await start([...sensorArgs.left("127.0.0.1:9"), "--metadata", "left.json"], json);
  await end(writer.child);
  const ports = { left: 20_000 + (process.pid % 20_000), right: 40_001 + (process.pid % 20_000) };
  writeFileSync(join(folder, "rig.toml"), `format = "outrigger-rig/1"
[[sensor]]
name = "left"
model = "os1-16"
listen = "127.0.0.1:${ports.left}"
metadata = "left.json"
[[sensor]]
name = "right"
model = "vlp-16"
listen = "127.0.0.1:${ports.right}"
[rig]
port = "rig"
timeout_s = 60
[predict]
mount = "mount.json"
room = "-6,-4,-1.5,6,4,2"
`);
  let running = await daemon("127.0.0.1:0");
  const daemons = [running.url];
  const sensors = {};
  for (const name of ["left", "right"]) sensors[name] = await start(sensorArgs[name](running.to[name]), json);

  const browser = await chromium.launch({ executablePath, args: ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"] });
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  page.setDefaultTimeout(PATIENCE);
  const errors = [];
  const outside = [];
  page.on("pageerror", (error) => errors.push(error.message));
  page.on("console", (message) => message.type() === "error" && !/ERR_CONNECTION_REFUSED|WebSocket|Failed to load resource/.test(message.text()) && errors.push(message.text()));
  // a page that is being left may still ask the daemon before
  const ours = (url) => url.startsWith("data:") || daemons.some((its) => url.startsWith(its));
  page.on("request", (request) => ours(request.url()) || outside.push(request.url()));
  await page.goto(running.url);
  const sees = (text) => page.getByText(text).first().waitFor().then(() => true, () => false);
  const gone = (text) => page.getByText(text).first().waitFor({ state: "hidden" }).then(() => true, () => false);
  // what the page says of a button follows with the next status, up to a fifth of a second later
  const becomesDisabled = (name) =>
    page.getByRole("button", { name, exact: true, disabled: true }).waitFor().then(() => true, () => false);
  const press = (name) => page.getByRole("button", { name, exact: true }).click();
  const drawn = () => page.evaluate(() => Number(document.getElementById("scene").dataset.drawn ?? 0));

  // the live view
  await page.waitForFunction(() => Number(document.getElementById("scene").dataset.drawn) > 5000, null, { timeout: PATIENCE });
  check("the view draws points and cells", (await drawn()) > 5000);
  const colours = () => page.evaluate(() => {
    const canvas = document.getElementById("scene");
    scene.draw();
    const gl = scene.gl;
    const pixels = new Uint8Array(4 * canvas.width * canvas.height);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const seen = new Set();
    let sum = 0;
    for (let at = 0; at < pixels.length; at += 4) {
      seen.add(pixels[at] >> 4 << 8 | pixels[at + 1] >> 4 << 4 | pixels[at + 2] >> 4);
      sum = (sum * 31 + pixels[at] + 3 * pixels[at + 1] + 7 * pixels[at + 2]) % 1_000_000_007;
    }
    return { count: seen.size, sum };
  });
  const picture = await colours();
  check("the picture has many colours", picture.count > 20, JSON.stringify(picture));
  await page.locator("#show-points").uncheck();
  await page.locator("#show-cells").uncheck();
  const bare = await colours();
  check("without layers it is bare", bare.count < picture.count / 2, `${bare.count} colours, ${picture.count} before`);
  await page.locator("#scene").focus();
  await page.keyboard.press("ArrowLeft");
  check("the keyboard turns it", (await colours()).sum !== bare.sum);
  await page.locator("#show-points").check();
  await page.locator("#show-cells").check();
  await press("Freeze");
  const still = await colours();
  await page.waitForTimeout(1000);
  check("a frozen picture stays", (await colours()).sum === still.sum);
  const sums = [still.sum];
  for (const colour of ["height", "reflectivity", "ring"]) {
    await page.locator("#colour-by").selectOption(colour);
    sums.push((await colours()).sum);
  }
  check("points are coloured by height, reflectivity and ring, over the coverage", new Set(sums).size === 4, sums.join(" "));
  await page.locator("#ring-to").fill("3");
  await page.locator("#ring-to").dispatchEvent("change");
  check("rings are filtered", (await colours()).sum !== sums[3]);
  await page.locator("#ring-to").fill("255");
  await page.locator("#ring-to").dispatchEvent("change");
  await page.locator("#colour-by").selectOption("sensor");
  await press("Go on");
  const faults = await seriousFaults(page);
  check("axe-core finds no serious fault", faults.length === 0, faults.join("\n     "));
  if (shots) await page.screenshot({ path: join(shots, "live.png"), fullPage: true });
  check("coverage is told against the prediction", await sees(/% of what is predicted/));

  // the recorder
  await page.getByLabel("Label").fill("seen by a browser");
  await press("Start recording");
  check("a recording starts", await sees(/^recording 0:/));
  await press("Stop recording");
  check("and is told when it ends", await sees(/session-.*: [\d,]+ packets, nothing lost/));

  // better pitches
  check("proposals wait for a recording", await becomesDisabled("Propose better pitches"));
  check("and that is said", await sees(/It needs a recording that goes on/));

  // the rig
  check("what is not homed is said", await sees("The rig is not homed"));
  check("nothing moves unarmed", await becomesDisabled("Apply the mount"));
  await press("Arm");
  await page.waitForFunction(() => !document.querySelector("[data-rig=home]").disabled);
  await press("Home");
  check("homing is answered", await sees("Home: done."));
  await press("Apply the mount");
  check("the mount is applied", await sees("Apply the mount: done."));
  check("achieved and target pitch stand beside each other", (await sees(/Axis 0: −1[12]\.\d\d°/)) && (await sees("target −12.00°")));
  await press("Start recording");
  await sees(/^recording 0:/);
  for (let attempt = 0; attempt < 40; attempt++) { // until the sensors have looked around
    await press("Propose better pitches");
    await page.getByText(/^Propose better pitches: (?!…)/).waitFor();
    if (await page.getByText("Propose better pitches: done.").isVisible()) break;
    await page.waitForTimeout(500);
  }
  check("a proposal is told in words", await sees(/would see \d+ cells of the surface mapped so far|No pitches were found that see clearly more/));
  const agree = page.getByRole("button", { name: "Move there, new session" });
  if (await agree.isVisible()) {
    await agree.click();
    check("who agrees is driven there", await sees("Move to the proposed pitches: done."));
    check("and recording goes on in a new session", await sees(/\(part 2\)/));
  } else {
    check("nothing better, nothing to agree to", await sees(/see clearly more than the present/));
  }
  await press("Stop recording");
  await press("Emergency stop");
  check("the emergency stop is told", (await sees("Emergency stop: done.")) && (await sees("The emergency stop is latched.")));
  await press("Clear faults");
  check("and goes when it is cleared", await gone("The emergency stop is latched."));

  // a lost sensor
  await end(sensors.right.child, "SIGKILL");
  check("a lost sensor shows", await sees(/right has sent nothing for/));
  sensors.right = await start(sensorArgs.right(running.to.right), json);
  check("and that it is back", await gone(/right has sent nothing for/));

  // the look of it
  for (const scheme of ["light", "dark"]) {
    for (const [name, width, height] of [["wide", 1280, 900], ["narrow", 390, 844]]) {
      await page.emulateMedia({ colorScheme: scheme });
      await page.setViewportSize({ width, height });
      await page.waitForTimeout(500);
      const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      check(`nothing sticks out, ${name} ${scheme}`, overflow <= 0, `${overflow} px`);
      const faint = await page.evaluate(faintTexts);
      check(`every text can be read, ${name} ${scheme}`, faint.length === 0, faint.slice(0, 5).join(" | "));
      if (shots) await page.screenshot({ path: join(shots, `page-${name}-${scheme}.png`), fullPage: true, timeout: 2 * PATIENCE });
    }
  }
  await page.setViewportSize({ width: 1280, height: 900 });
  const nameless = await page.evaluate(() => [...document.querySelectorAll("button, input, canvas")].filter((element) => !(element.ariaLabel || element.textContent.trim() || element.labels?.length || element.getAttribute("aria-labelledby"))).map((element) => element.outerHTML));
  check("every control has a name", nameless.length === 0, nameless.join(" "));
  await page.locator(".skip").focus();
  const stops = [];
  for (let at = 0; at < 6; at++) {
    await page.keyboard.press("Tab");
    stops.push(await page.evaluate(() => document.activeElement.id || document.activeElement.dataset.rig));
  }
  check("the keyboard comes to the emergency stop first", stops[0] === "e-stop" && stops.includes("scene"), stops.join(", "));

  // the daemon restarts
  const address = new URL(running.url).host;
  const code = await end(running.child);
  check("the daemon ends in peace", code === 0, `exit code ${code}`);
  check("the page says that the daemon is gone", await sees(/no connection to the daemon/));
  running = await daemon(address);
  daemons.push(running.url);
  check("and finds it again by itself", (await gone(/no connection to the daemon/)) && (await sees(/% of what is predicted/)));
  await end(running.child);

  // a token
  writeFileSync(join(folder, "token"), "correct-horse-battery\n");
  const closed = await start(["--json", "daemon", "--config", "rig.toml", "--listen", "127.0.0.1:0", "--token-file", "token"], json);
  running = { child: closed.child, url: closed.found.url };
  daemons.push(running.url);
  await page.goto(running.url);
  await page.locator("#token").fill("wrong-horse-battery");
  await press("Open");
  check("a wrong token is told", await sees("that is not the daemon's token"));
  await page.locator("#token").fill("correct-horse-battery");
  await press("Open");
  check("the right one opens the page", await sees(/% of what is predicted|cells of 25 cm seen/));

  check("no error in the page", errors.length === 0, errors.join(" | "));
  check("nothing is fetched from elsewhere", outside.length === 0, outside.join(" "));
  await browser.close();
}

// texts whose contrast with what is behind them is less than 4.5 to 1 (WCAG 2, AA)
function faintTexts() {
  const parse = (text) => (text.match(/[\d.]+/g) ?? []).map(Number);
  const light = ([r, g, b]) => {
    const linear = [r, g, b].map((value) => value / 255).map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4));
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = parse(getComputedStyle(at).backgroundColor);
      if (colour.length === 3 || colour[3] > 0) return colour;
    }
    return [255, 255, 255];
  };
  const faint = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (!walker.currentNode.textContent.trim() || !element.checkVisibility() || element.closest(":disabled, dialog:not([open]), noscript, .skip")) continue;
    const [a, b] = [light(parse(getComputedStyle(element).color)), light(behind(element))];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < 4.5) faint.push(`${walker.currentNode.textContent.trim().slice(0, 30)} (${contrast.toFixed(1)})`);
  }
  return faint;
}

try {
  await main();
} catch (error) {
  check("the whole run", false, error.stack);
} finally {
  for (const child of children) child.kill("SIGKILL");
  if (existsSync(folder)) rmSync(folder, { recursive: true });
}
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed > 0 ? 1 : 0);
