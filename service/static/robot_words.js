// The words of the views Robots, Robot and Watch, for the one table: English, German.

export const ROBOT_WORDS = {
  view_of_robot: ["Robot", "Roboter"], view_of_watch: ["Watch", "Überwachung"],
  // the state of a robot
  robot_unchanged: ["unchanged", "unverändert"], robot_changed: ["changed", "verändert"], robot_ambiguous: ["changed, several causes look alike", "verändert, mehrere Ursachen sehen gleich aus"],
  robot_unexplained: ["changed, no single cause explains it", "verändert, keine einzelne Ursache erklärt es"], robot_recalibrated: ["calibrated since the last watch", "seit der letzten Überwachung kalibriert"], robot_not_watched: ["never watched", "nie überwacht"],
  said_unchanged: ["unchanged", "unverändert"], said_changed: ["changed", "verändert"], said_ambiguous: ["ambiguous", "mehrdeutig"], said_unexplained: ["unexplained", "unerklärt"],
  said_complete: ["complete", "vollständig"], said_attributed: ["attributed", "zugeordnet"], said_excess_noise: ["more noise than declared", "mehr Rauschen als angegeben"],
  said_thermal: ["warmth, or nothing", "Wärme oder nichts"], "said_not thermal": ["something else than warmth", "etwas anderes als Wärme"],
  doPlan: ["Plan a watch, and measure its check poses.", "Eine Überwachung planen und ihre Prüfposen messen."],
  watchedOn: ["Watch of {date}:", "Überwachung vom {date}:"],
  lastCause: ["Cause", "Ursache"], classOfCauses: ["One of these causes, the likeliest", "Eine dieser Ursachen, die wahrscheinlichste"], errorOf: ["error", "Fehler"], permitted: ["permitted", "erlaubt"], noCause: ["none", "keine"], orOthers: ["or {n} more", "oder {n} weitere"], inWords: ["In words", "In Worten"], shareOfClass: ["Likely", "Wahrscheinlich"],
  positionError: ["Position error, RMS", "Positionsfehler, RMS"], lastMeasured: ["Last measured", "Zuletzt gemessen"], cells: ["Cells", "Zellen"], baseline: ["Baseline of", "Bezugsmodell vom"],
  // the list
  robotsKept: ["Robots of the history", "Roboter der Historie"], noRobots: ["None yet: whatever is measured, diagnosed and watched here enters by itself.", "Noch keine: was hier gemessen, diagnostiziert und überwacht wird, kommt von selbst hinein."],
  noErrors: ["no error known yet", "noch kein Fehler bekannt"], sparkSays: ["Position errors of {n} checks since {first}; last {last}", "Positionsfehler aus {n} Prüfungen seit {first}; zuletzt {last}"],
  storeIs: ["Kept in {store}.", "Aufbewahrt in {store}."], permittedIs: ["Permitted: {mm} mm RMS.", "Erlaubt: {mm} mm RMS."],
  permittedUnknown: ["Nobody has said which error is permitted (truepose serve --permitted MM), so there are no dates.", "Niemand hat gesagt, welcher Fehler erlaubt ist (truepose serve --permitted MM); deshalb gibt es keine Termine."],
  robotsLeftOut: ["{n} more are not shown.", "{n} weitere sind nicht gezeigt."], notKept: ["Not in the history: {n}", "Nicht in der Historie: {n}"], allResultsHere: ["All results of this service", "Alle Ergebnisse dieses Dienstes"],
  addDocuments: ["Add documents from elsewhere", "Dokumente von anderswo hinzufügen"], addDocumentsHint: ["Models, verdicts of watches, diagnoses, upkeeps: JSON files as the program wrote them.", "Modelle, Urteile von Überwachungen, Diagnosen, Wärmenachführungen: JSON-Dateien, wie das Programm sie schrieb."],
  documentFiles: ["Files", "Dateien"], serialWhereNone: ["Serial number, where a file has none", "Seriennummer, wo eine Datei keine hat"], keepThem: ["Keep them", "Aufbewahren"],
  added_new: ["kept", "aufbewahrt"], added_known: ["known already", "schon bekannt"], added_conflict: ["kept; contradicts another document of the same thing", "aufbewahrt; widerspricht einem anderen Dokument zur selben Sache"],
  // dates
  nextCheck: ["Next check", "Nächste Prüfung"], noDate: ["no date", "kein Termin"], overdueSince: ["overdue since {date}", "überfällig seit {date}"], byIlac: ["ILAC-G24, {method}.", "ILAC-G24, {method}."],
  method_staircase: ["staircase: longer after good checks", "Treppe: länger nach guten Prüfungen"], method_drift: ["drift: before the error leaves what is permitted", "Drift: bevor der Fehler das Erlaubte verlässt"],
  permittedError: ["Permitted error, mm RMS", "Erlaubter Fehler, mm RMS"], byMethod: ["Method", "Verfahren"], reckonAgain: ["Reckon", "Berechnen"],
  // trends
  trends: ["Trends", "Verläufe"], noTrends: ["No values yet.", "Noch keine Werte."], lastValue: ["Last", "Zuletzt"], olderLeftOut: ["{n} older ones are not shown.", "{n} ältere sind nicht gezeigt."],
  trendSays: ["{name}: {n} values, last {last}, {out} outside the limits", "{name}: {n} Werte, zuletzt {last}, {out} außerhalb der Grenzen"],
  steadyOnes: ["{n} parameters within their limits", "{n} Parameter innerhalb ihrer Grenzen"], singleOnes: ["{n} parameters with one value", "{n} Parameter mit einem Wert"],
  markValue: ["value and U (k = 2)", "Wert und U (k = 2)"], markLimits: ["control limits", "Eingriffsgrenzen"], markCentre: ["centre of the first values", "Mitte der ersten Werte"], markSignal: ["signal: it, or its mean with those before, is outside", "Signal: er oder sein Mittel mit den früheren liegt außerhalb"],
  parameter: ["Parameter", "Parameter"], value: ["Value", "Wert"], unit: ["Unit", "Einheit"], before: ["Before", "Vorher"],
  // documents
  documents: ["Documents", "Dokumente"], document_model: ["model", "Modell"], document_watch: ["watch", "Überwachung"], document_campaign: ["campaign", "Kampagne"], document_dataset: ["data set", "Datensatz"], document_diagnosis: ["diagnosis", "Diagnose"], document_thermal: ["upkeep", "Wärmenachführung"],
  contradicts: ["contradicts another", "widerspricht einem anderen"],
  // planning and judging
  kind_watch_plan: ["plan of a watch", "Plan einer Überwachung"], kind_watch: ["watch", "Überwachung"], kind_upkeep: ["thermal upkeep", "Wärmenachführung"],
  planWatch: ["Plan a watch", "Überwachung planen"], baselineHint: ["Check poses in this cell, judged by a model of this robot. Nothing moves.", "Prüfposen in dieser Zelle, beurteilt nach einem Modell dieses Roboters. Nichts bewegt sich."],
  judgedBy: ["Judged by the model of", "Beurteilt nach dem Modell vom"], updatedByWatch: ["without readings held out, or updated", "ohne zurückgehaltene Messungen, oder nachgeführt"],
  checkPoses: ["Check poses", "Prüfposen"], visitsEach: ["Visits to each", "Besuche je Pose"], visitsOrEnough: ["Visits to each; empty: as few as are enough", "Besuche je Pose; leer: so wenige wie genügen"], readingsOrEnough: ["Readings in a visit; empty: as few as are enough", "Ablesungen je Besuch; leer: so wenige wie genügen"], targetsOrAll: ["Targets; empty: all", "Ziele; leer: alle"], newFrame: ["instrument stands elsewhere", "Instrument steht woanders"],
  judgeReadings: ["Judge readings", "Messungen beurteilen"], judgeHint: ["A run of check poses, or a data set of this robot: has it changed? Upkeep updates how warm the arm is, and nothing else.", "Ein Lauf mit Prüfposen oder ein Datensatz dieses Roboters: hat er sich verändert? Die Wärmenachführung ändert nur, wie warm der Arm ist."],
  readingsOf: ["Readings of", "Messungen von"], noReadings: ["no data set yet", "noch kein Datensatz"], runningSince: ["Had run since cold, s", "Lief seit kalt, s"], allowMissing: ["poses may be missing", "Posen dürfen fehlen"], judge: ["Judge", "Beurteilen"], upkeep: ["Upkeep", "Wärme nachführen"],
  watchesHere: ["Plans and watches of this service", "Pläne und Überwachungen dieses Dienstes"],
  watchShows: ["What these poses will show", "Was diese Posen zeigen werden"], watchShowsHint: ["{poses} poses, {readings} readings of {targets}; {percent} % false alarms.", "{poses} Posen, {readings} Messungen von {targets}; {percent} % Fehlalarme."],
  seenFrom: ["Seen from", "Gesehen ab"], aloneFrom: ["Named alone from", "Allein benannt ab"], neverAlone: ["never", "nie"], neverApart: ["Never told from", "Nie unterschieden von"], notSeenCauses: ["Not seen by these readings", "Von diesen Messungen nicht gesehen"],
  nestsSeen: ["A nest that moved by {mm} mm is seen; the check allows {limit} mm.", "Ein Nest, das sich um {mm} mm bewegt hat, wird gesehen; die Prüfung erlaubt {limit} mm."],
  toSeeMore: ["What it would take to see more", "Was nötig wäre, um mehr zu sehen"], seesAll: ["Sees all", "Sieht alle"], seenWorst: ["Seen worst", "Am schlechtesten gesehen"],
  nextSteps: ["What comes next", "Wie es weitergeht"], watchNext: ["Keep the check poses as a campaign, check and start it as any other; when it has succeeded, judge the run below.", "Die Prüfposen als Kampagne behalten, prüfen und starten wie jede andere; ist sie gelungen, den Lauf unten beurteilen."],
  howSure: ["How sure", "Wie sicher"], errorAtPoses: ["The baseline misses the check poses by {rms} RMS, {max} mm at most.", "Das Bezugsmodell verfehlt die Prüfposen um {rms} RMS, höchstens {max} mm."],
  watchesCounted: ["Watches", "Überwachungen"], itsLimit: ["limit", "Grenze"], alarm: ["Alarm", "Alarm"], yes: ["yes", "ja"], no: ["no", "nein"],
  updatedModel: ["Download the updated model", "Nachgeführtes Modell herunterladen"], updatedHint: ["Targets are corrected with it as with any model.", "Ziele werden damit korrigiert wie mit jedem Modell."], thermalParameters: ["Thermal parameters", "Wärmeparameter"],
};
