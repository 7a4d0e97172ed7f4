// Reports in a real browser: they ask nobody for anything, no script or style fails, their pictures have a size, their 3-D pictures
// can be turned, cut and asked for blind spots, and without WebGL a picture stands there; axe-core finds no serious fault.
//
//     node tests/browser/reports.mjs CHROMIUM FOLDER...
//
// Every .html in the folders is opened from the disk. Ends with `N passed, N failed`; exit status 1 when a check failed, and
// when there was no report at all.
import { existsSync, readFileSync, readdirSync, statSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";
import { seriousFaults } from "./accessible.mjs";

const [executablePath, ...folders] = process.argv.slice(2);
const shots = process.env.SHOTS; // a folder for pictures of every page: light, dark, phone, print
let [passed, failed] = [0, 0];

function check(name, holds, detail) {
  if (holds) passed += 1;
  else failed += 1;
  console.log(`${holds ? "ok  " : "FAIL"} ${name}${holds ? "" : ` ${detail}`}`);
}

const reports = folders.flatMap((folder) => existsSync(folder) ? readdirSync(folder, { recursive: true }).filter((name) => name.endsWith(".html")).map((name) => resolve(join(folder, name))) : []);
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"] });
const withoutGl = await chromium.launch({ executablePath, args: ["--no-sandbox", "--disable-3d-apis"] });

// the 3-D picture of a page: what it is made of moves and hides
async function turnsAround(page, report) {
  const canvas = page.locator("figure.orbit canvas").first();
  await page.waitForFunction(() => Number(document.querySelector("figure.orbit canvas").dataset.drawn) > 0, null, { timeout: 60_000 });
  const sum = () => page.evaluate(() => {
    const { view } = orbits[0];
    view.draw();
    const { gl } = view;
    const bytes = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
    gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return bytes.reduce((sum, byte, at) => (sum * 31 + byte * ((at % 251) + 1)) % 2147483647, 7);
  });
  const before = await sum();
  await canvas.hover();
  await page.mouse.down();
  await page.mouse.move(500, 300, { steps: 3 });
  await page.mouse.up();
  const turned = await sum();
  check(`${report}: its 3-D picture turns`, turned !== before);
  await page.locator("figure.orbit").getByRole("button", { name: "Reset" }).click();
  check(`${report}: and comes back`, (await sum()) === before);
  await page.locator("figure.orbit fieldset input").nth(1).uncheck();
  check(`${report}: a layer can be hidden`, (await sum()) !== before);
  await page.locator("figure.orbit fieldset input").nth(1).check();
  const spot = page.locator("[data-look]").first();
  if ((await spot.count()) > 0) {
    const place = (await spot.getAttribute("data-look")).split(",").map(Number);
    await spot.click();
    const middle = await page.evaluate(() => orbits[0].view.middle);
    check(`${report}: a blind spot is gone to`, middle.every((value, axis) => Math.abs(value - place[axis]) < 1e-6), `${middle} ${place}`);
  }
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: /^SVG/ }).first().click()]);
  const charts = await page.evaluate(() => [...document.querySelectorAll("svg.chart, svg.cells")].map((svg) => rows(svg).split("\r\n").length));
  check(`${report}: every figure has data to save`, charts.length > 0 && charts.every((count) => count > 1), charts.join(" "));
  check(`${report}: a figure is saved as SVG`, readFileSync(await download.path(), "utf8").startsWith("<svg"));
}

// a page where there is no WebGL
async function hasPicture(url, report) {
  const page = await withoutGl.newPage({ viewport: { width: 1280, height: 900 } });
  await page.goto(url);
  const picture = page.locator("figure.orbit svg.cells").first();
  check(`${report}: a picture without WebGL`, (await picture.isVisible()) && (await page.locator("figure.orbit canvas").count()) === 0);
  await page.close();
}
for (const report of reports) {
  const url = pathToFileURL(report).href;
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  const [errors, outside] = [[], []];
  page.on("pageerror", (error) => errors.push(error.message));
  page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
  page.on("request", (request) => request.url() !== url && !request.url().startsWith("data:") && outside.push(request.url()));
  await page.goto(url);
  const seen = await page.evaluate(() => ({
    title: document.title,
    words: document.body.innerText.length,
    flat: [...document.querySelectorAll("svg, img")].filter((picture) => !picture.closest("details:not([open])") && picture.getBoundingClientRect().width < 8).length,
    wide: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  }));
  check(`${report}: asks nobody`, outside.length === 0, outside.join(" "));
  check(`${report}: no error`, errors.length === 0, errors.join(" | "));
  check(`${report}: has a title, words and pictures of a size, within the window`, seen.title && seen.words > 200 && seen.flat === 0 && seen.wide <= 0, JSON.stringify(seen));
  check(`${report}: below 8 MB`, statSync(report).size < 8e6);
  const faults = await seriousFaults(page);
  check(`${report}: no serious fault of axe-core`, faults.length === 0, faults.join("\n     "));
  if ((await page.locator("figure.orbit").count()) > 0) {
    await turnsAround(page, report);
    await hasPicture(url, report);
  }
  check(`${report}: says version, day and command once`, (await page.locator("footer #command").count()) === 1 && /Outrigger \d+\.\d+\.\d+, \d{4}-\d\d-\d\d/.test(await page.textContent("footer")));
  if (shots) {
    const name = `${report.split("/").slice(-2).join("-").replace(".html", "")}`;
    for (const [what, colorScheme, media, width] of [["light", "light", "screen", 1280], ["dark", "dark", "screen", 1280], ["phone", "light", "screen", 390], ["print", "light", "print", 800]]) {
      await page.setViewportSize({ width, height: 900 });
      await page.emulateMedia({ colorScheme, media });
      await page.waitForTimeout(500);
      await page.screenshot({ path: join(shots, `${name}-${what}.png`), fullPage: true });
    }
  }
  await page.close();
}
await browser.close();
await withoutGl.close();
if (reports.length < 2) check("there are reports", false, `${reports.length} found`);
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed > 0 ? 1 : 0);
