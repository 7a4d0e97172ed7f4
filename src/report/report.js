// What a report's buttons do: the command to the clipboard, a figure as SVG, its data as CSV. Prints with every section open.
"use strict";

function save(text, kind, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// a picture by itself, with the page's colours
function alone(svg) {
  const copy = svg.cloneNode(true);
  copy.setAttribute("xmlns", svg.namespaceURI);
  const style = document.createElementNS(svg.namespaceURI, "style");
  style.textContent = document.querySelector("style").textContent;
  copy.prepend(style);
  return new XMLSerializer().serializeToString(copy);
}

// rows of a chart as it holds them; of a map the runs of its cells
function rows(svg) {
  const data = svg.querySelector("metadata");
  if (data) return data.textContent.replace(/\r?\n/g, "\r\n"); // HTML knows one line end
  const height = Number(svg.dataset.rows);
  const lines = ["column,row,class"];
  for (const path of svg.querySelectorAll('path[class^="c-"]')) {
    for (const [, x, y, run] of path.getAttribute("d").matchAll(/M(\d+) (\d+)h(\d+)v1h-\d+z/g)) {
      for (let at = 0; at < Number(run); at++) lines.push(`${Number(x) + at},${height - 1 - Number(y)},${path.getAttribute("class").slice(2)}`);
    }
  }
  return lines.join("\r\n");
}

document.querySelectorAll("figure").forEach((figure, number) => {
  const pictures = [...figure.querySelectorAll("svg.chart, svg.cells")];
  if (pictures.length === 0) return;
  const bar = document.createElement("p");
  bar.className = "downloads";
  pictures.forEach((svg, at) => {
    const name = `figure-${number + 1}${pictures.length > 1 ? `-${at + 1}` : ""}`;
    for (const [kind, make] of [["SVG", () => save(alone(svg), "image/svg+xml", `${name}.svg`)], ["CSV", () => save(rows(svg), "text/csv", `${name}.csv`)]]) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: pictures.length > 1 ? `${kind} ${at + 1}` : kind });
      button.title = `Save picture ${at + 1} of figure ${number + 1} as ${kind}`;
      button.addEventListener("click", make);
      bar.append(button);
    }
  });
  (figure.querySelector("figcaption") ?? figure).append(bar);
});

const copy = document.getElementById("copy");
copy?.addEventListener("click", async () => {
  await navigator.clipboard?.writeText(document.getElementById("command").textContent);
  copy.textContent = "Copied";
});
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((fold) => (fold.open = true)));
