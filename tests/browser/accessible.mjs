// What axe-core says of a page: no serious or critical fault, in light and in dark.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

// faults by rule and element, in words; none where the page is as it should be
export async function seriousFaults(page) {
  await page.evaluate(axe);
  const faults = [];
  for (const colorScheme of ["dark", "light"]) {
    await page.emulateMedia({ colorScheme });
    const { violations } = await page.evaluate(() => axe.run(document, { resultTypes: ["violations"] }));
    const serious = violations.filter(({ impact }) => impact === "serious" || impact === "critical");
    faults.push(...serious.flatMap(({ id, nodes }) => nodes.map((node) => `${colorScheme} ${id}: ${node.html.slice(0, 120)} ${node.any[0]?.message ?? ""}`)));
  }
  return faults;
}
