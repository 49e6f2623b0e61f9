// Values at the cursor on the plots of ballbar/report/line_plot.py. Read off the drawn curves, so
// to the width of a line; where a curve has several points at the cursor, their range is shown.
"use strict";
const box = document.createElement("div");
box.className = "hover";
box.hidden = true;
document.body.append(box);

const numbers = (text) => text.split(" ").map(Number);
const shown = (value) => Number(value.toPrecision(3)).toString().replace("-", "\u2212");

function between([low, high], share, log) {
  if (log) return low * (high / low) ** share;
  const v = low + share * (high - low);
  return Math.abs(v) < 1e-3 * (high - low) ? 0 : v;
}

function curves(plot) {
  plot.curves ??= [...plot.querySelectorAll("path[data-name]")].map((path) => ({
    name: path.dataset.name,
    colour: path.getAttribute("stroke") ?? path.getAttribute("fill"),
    points: [...path.getAttribute("d").matchAll(/[ML](\S+) ([\d.]+)/g)].map((m) => [+m[1], +m[2]]),
  }));
  return plot.curves;
}

function lines(plot, x) {
  const [, top, , tall] = numbers(plot.dataset.box);
  const value = (y) => between(numbers(plot.dataset.y), (top + tall - y) / tall, numbers(plot.dataset.log)[1]);
  return curves(plot).filter((c) => c.points.length).map((c) => {
    const nearest = c.points.reduce((a, b) => (Math.abs(b[0] - x) < Math.abs(a[0] - x) ? b : a));
    const ys = c.points.filter((p) => Math.abs(p[0] - nearest[0]) < 0.5).map((p) => value(p[1]));
    const [a, b] = [shown(Math.min(...ys)), shown(Math.max(...ys))];
    return { colour: c.colour, text: `${c.name} ${a === b ? a : `${a} \u2026 ${b}`}`.trim() };
  });
}

for (const svg of document.querySelectorAll("svg.plots")) {
  const plots = [...svg.querySelectorAll("g.plot")];
  const cursor = document.createElementNS(svg.namespaceURI, "line");
  cursor.setAttribute("class", "cursor");
  svg.append(cursor);
  const leave = () => {
    box.hidden = true;
    cursor.style.display = "none";
  };
  svg.addEventListener("pointerleave", leave);
  svg.addEventListener("pointermove", (event) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const inside = plots.find((plot) => {
      const [left, top, wide, tall] = numbers(plot.dataset.box);
      return at.x >= left && at.x <= left + wide && at.y >= top && at.y <= top + tall;
    });
    if (!inside) return leave();
    const [left, top, wide, tall] = numbers(inside.dataset.box);
    for (const [name, value] of Object.entries({ x1: at.x, x2: at.x, y1: top, y2: top + tall }))
      cursor.setAttribute(name, value);
    cursor.style.display = "";
    const head = document.createElement("div");
    head.textContent = shown(between(numbers(inside.dataset.x), (at.x - left) / wide, numbers(inside.dataset.log)[0]));
    box.replaceChildren(head, ...lines(inside, at.x).map((line) => {
      const row = document.createElement("div");
      row.textContent = line.text;
      row.style.color = line.colour;
      return row;
    }));
    box.hidden = false;
    const right = event.clientX + 16 + box.offsetWidth < window.innerWidth;
    box.style.left = `${event.pageX + (right ? 14 : -14 - box.offsetWidth)}px`;
    box.style.top = `${event.pageY + 14}px`;
  });
}
