// What all pages do with JavaScript: the clock, the mark of a lost connection, menus that close.

/** @type {HTMLElement | null} */
const clock = document.querySelector("[data-clock]");
if (clock !== null) {
  const form = new Intl.DateTimeFormat("en-GB", { hour: "2-digit", minute: "2-digit", timeZone: clock.dataset.zone });
  const show = () => {
    const text = form.format(new Date());
    if (clock.textContent !== text) clock.textContent = text;
  };
  show();
  setInterval(show, 1000);
}

document.addEventListener("click", (event) => {
  for (const menu of document.querySelectorAll("details.menu[open]")) {
    if (event.target instanceof Node && !menu.contains(event.target)) menu.removeAttribute("open");
  }
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") document.querySelector("details.menu[open]")?.removeAttribute("open");
});

// A page with a stream of the station hears from it at least every 15 s; without that its values are of the past.
const SILENT_MS = 6000;
const lost = document.getElementById("lost");
if (lost !== null && document.querySelector("[sse-connect]") !== null) {
  let heard = Date.now();
  const alive = () => {
    heard = Date.now();
    lost.hidden = true;
    document.body.classList.remove("stale");
  };
  document.body.addEventListener("htmx:sseBeforeMessage", alive);
  document.body.addEventListener("htmx:sseOpen", alive);
  document.addEventListener("visibilitychange", () => {
    if (!document.hidden) heard = Math.max(heard, Date.now() - SILENT_MS + 2000);
  });
  setInterval(() => {
    if (Date.now() - heard > SILENT_MS && lost.hidden) {
      lost.textContent = `${lost.dataset.words} ${new Date(heard).toLocaleTimeString("en-GB")}.`;
      lost.hidden = false;
      document.body.classList.add("stale");
    }
  }, 1000);
}
