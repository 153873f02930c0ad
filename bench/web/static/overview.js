// All benches: the number of those that wait for a person is in the title of the window; a filter applies at once.
// @ts-check

const title = document.title;

function showWaiting() {
  const counts = document.querySelector("[data-waiting]");
  const waiting = counts instanceof HTMLElement ? Number(counts.dataset.waiting) : 0;
  const text = waiting > 0 ? `(${waiting}) ${title}` : title;
  if (document.title !== text) document.title = text;
}

showWaiting();
document.body.addEventListener("htmx:sseMessage", showWaiting);

for (const field of document.querySelectorAll("[data-submits]")) {
  field.addEventListener("change", () => field.closest("form")?.requestSubmit());
}
