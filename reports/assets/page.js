// Start: theme, viewer, links from the skill map into the viewer.

const THEME = "malus-theme";

function wear(theme) {
  document.documentElement.dataset.theme = theme;
  document.getElementById("theme").setAttribute("aria-pressed", String(theme === "dark"));
}

function startTheme() {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  let kept = null;
  try { kept = localStorage.getItem(THEME); } catch { /* a locked-down browser forgets */ }
  wear(kept || (dark.matches ? "dark" : "light"));
  dark.addEventListener("change", () => { if (!kept) wear(dark.matches ? "dark" : "light"); });
  document.getElementById("theme").addEventListener("click", () => {
    kept = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    wear(kept);
    try { localStorage.setItem(THEME, kept); } catch { /* as above */ }
  });
}

function startViewer() {
  const root = document.getElementById("viewer");
  if (!root) return;
  const data = JSON.parse(document.getElementById("viewer-data").textContent);
  const viewer = new Viewer(root, data);
  for (const button of document.querySelectorAll("button[data-scene]")) {
    button.addEventListener("click", () => {
      const select = viewer.find("scene");
      select.value = data.scenes.findIndex((scene) => scene.id === button.dataset.scene);
      viewer.chooseScene();
      const method = viewer.find("method");
      if (viewer.scene.methods[button.dataset.method]) method.value = button.dataset.method;
      viewer.load();
      root.scrollIntoView();
      select.focus({ preventScroll: true });
    });
  }
}

/** Buttons that copy the command beside them; where a browser refuses, it is marked to be copied. */
function startCopying() {
  for (const button of document.querySelectorAll("button.copy")) {
    const code = button.parentElement.querySelector("code");
    button.addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(code.textContent);
        button.textContent = "Copied";
      } catch {
        window.getSelection().selectAllChildren(code);
        button.textContent = "Marked: copy it";
      }
    });
  }
}

startTheme();
startCopying();
startViewer();
requestAnimationFrame(() => requestAnimationFrame(() => {
  document.documentElement.dataset.ready = performance.now().toFixed(0);
}));
