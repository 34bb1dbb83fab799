"use strict";
const figures = JSON.parse(document.getElementById("figures").textContent);
const touch = matchMedia("(pointer: coarse)").matches;
const settings = {
  responsive: true,
  displaylogo: false,
  displayModeBar: touch ? false : "hover",
  plotlyServerURL: "",
  modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "resetCameraLastSave3d", "hoverClosest3d"],
};

// a trace in space knows its heights row by row; the surface has as many corners in each row
function raised(trace, view) {
  if (!trace.heights) return trace;
  const {heights, spread, shades, ...own} = trace;
  const rows = heights[view] || Object.values(heights)[0];
  const over = (values) => (spread ? values.map((value) => Array(spread).fill(value)) : values);
  return {...own, z: over(rows), ...(shades ? {surfacecolor: over(shades)} : {})};
}

function draw(name, view) {
  const place = document.getElementById(`figure-${name}`);
  const {traces, layout, views} = figures[name];
  const shown = structuredClone(layout);
  if (!shown.scene && touch) shown.dragmode = false; // a finger scrolls the page
  if (shown.scene && place.clientWidth < 560) {
    for (const axis of "xyz") shown.scene.camera.eye[axis] *= 1.18; // all of it, beside less room
  }
  if (view) shown.scene.zaxis.title.text = views.find((each) => each[0] === view)[2];
  if (name === "sections" && place.clientWidth < 560) stack(shown);
  return Plotly.react(place, traces.map((trace) => raised(trace, view)), shown, settings);
}

// on a narrow page panels stand below each other
function stack(layout) {
  ["", "2", "3"].forEach((number, k) => {
    layout[`xaxis${number}`].domain = [0, 1];
    layout[`yaxis${number}`].domain = [1 - (k + 1) / 3 + (k < 2 ? 0.07 : 0.02), 1 - k / 3 - 0.02];
  });
}

function tall(name) {
  const place = document.getElementById(`figure-${name}`);
  const shape = figures[name].shape;
  if (shape) {
    const height = (place.clientWidth - 80) / shape + 110;
    place.style.height = `${Math.min(Math.max(height, 260), 0.8 * Math.max(innerHeight, 640))}px`;
  }
  if (name === "sections" && place.clientWidth < 560) place.style.height = "900px";
}

async function start() {
  for (const [name, {views}] of Object.entries(figures)) {
    tall(name);
    await draw(name, views.length ? views[0][0] : null);
  }
  for (const button of document.querySelectorAll("button[data-view]")) {
    button.addEventListener("click", async () => {
      for (const other of document.querySelectorAll("button[data-view]")) {
        other.setAttribute("aria-pressed", String(other === button));
      }
      await draw("space", button.dataset.view);
    });
  }
  const copy = document.getElementById("copy");
  if (copy) {
    copy.addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(document.getElementById("command").textContent.trim());
        copy.textContent = "copied";
      } catch {
        getSelection().selectAllChildren(document.getElementById("command"));
      }
    });
  }
  document.documentElement.dataset.drawn = "true";
}

// what stands in view is marked in the table of contents
const links = new Map([...document.querySelectorAll("nav a")].map((link) => [link.hash.slice(1), link]));
const watcher = new IntersectionObserver(
  (entries) => {
    for (const entry of entries) {
      if (entry.isIntersecting) {
        links.forEach((link, id) => link.toggleAttribute("aria-current", id === entry.target.id));
      }
    }
  },
  {rootMargin: "-10% 0px -75% 0px"},
);
document.querySelectorAll("main section[id]").forEach((section) => watcher.observe(section));
start();
