// Controls too small for a finger (WCAG 2.2, target size: 24 px high; radio buttons and ticks have their label).
() => [...document.querySelectorAll('button, select, a, input')]
  .filter((e) => e.checkVisibility() && !e.closest('.sr, .skip'))
  .map((e) => [e.textContent || e.id, (e.closest('label') ?? e).getBoundingClientRect()])
  .filter(([, box]) => box.width > 0 && (box.height < 24 || box.width < 24))
  .map(([text, box]) => `${text} ${box.width} x ${box.height}`)
