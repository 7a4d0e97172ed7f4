// Reports in a real browser: they ask nobody for anything, no script or style fails, and their pictures have a size.
//
//     node tests/browser/reports.mjs CHROMIUM FOLDER...
//
// Every .html in the folders is opened from the disk. Ends with `N passed, N failed`; exit status 1 when a check failed, and
// when there was no report at all.
import { existsSync, readdirSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [executablePath, ...folders] = process.argv.slice(2);
let [passed, failed] = [0, 0];

function check(name, holds, detail) {
  if (holds) passed += 1;
  else failed += 1;
  console.log(`${holds ? "ok  " : "FAIL"} ${name}${holds ? "" : ` ${detail}`}`);
}

const reports = folders.flatMap((folder) => existsSync(folder) ? readdirSync(folder, { recursive: true }).filter((name) => name.endsWith(".html")).map((name) => resolve(join(folder, name))) : []);
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
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
  await page.close();
}
await browser.close();
if (reports.length < 2) check("there are reports", false, `${reports.length} found`);
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed > 0 ? 1 : 0);
