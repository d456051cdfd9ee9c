// The sentences of the service in the language of the page: English as the service says it, German. What stands in
// {braces} is taken over. A sentence that is not here stays English, and is marked so (docs/decisions/0105).

import { DEVICE_SENTENCES } from "./device_sentences.js";
import { h } from "./dom.js";
import { EFFECT_SENTENCES } from "./effect_sentences.js";
import { language, t } from "./words.js";

const SENTENCES = [
  // acceptance
  ["Accepted where the figure plus its expanded uncertainty U (95 %) is within the limit, rejected where the figure less U is beyond it, otherwise not decided (guard bands as in ISO 14253-1).",
    "Angenommen, wo der Wert samt seiner erweiterten Unsicherheit U (95 %) innerhalb der Grenze liegt; abgelehnt, wo er abzüglich U jenseits liegt; sonst nicht entschieden (Sicherheitsabstand wie in ISO 14253-1)."],
  // why a run is not running
  ["Paused on request.", "Auf Wunsch pausiert."], ["Stopped on request.", "Auf Wunsch angehalten."], ["Stopped on request; {rest}.", "Auf Wunsch angehalten; {rest}"],
  ["The service was ended.", "Der Dienst wurde beendet."], ["The program was interrupted.", "Das Programm wurde unterbrochen."], ["{who} was not heard of for {n} s.", "Von {who} kam {n} s lang nichts."],
  ["Not one pose could be measured.", "Keine einzige Pose konnte gemessen werden."], ["{n} reading was skipped.", "{n} Messung wurde ausgelassen."], ["{n} readings were skipped.", "{n} Messungen wurden ausgelassen."],
  ["Most is missing: {n} of {m} readings were measured.", "Das meiste fehlt: {n} von {m} Messungen wurden gemacht."], ["The terminal was closed.", "Das Terminal wurde geschlossen."],
  ["The instrument was moved: its readings come from {n} stations.", "Das Messgerät wurde versetzt: seine Messungen stammen von {n} Standpunkten."],
  ["Press the emergency stop: the program does not reach the robot, which may still be moving.", "Not-Halt drücken: das Programm erreicht den Roboter nicht, und er fährt vielleicht noch."],
  ["Nothing is connected since this link was lost: press the emergency stop if the robot moves.", "Seit diese Verbindung abriss, ist nichts verbunden: bewegt sich der Roboter, Not-Halt drücken."],
  ["Press the stop button of the controller: this robot cannot be stopped by the program.", "Den Halt-Taster der Steuerung drücken: diesen Roboter kann das Programm nicht anhalten."],
  // devices: what happened
  ["{device}: {rest}.", "{device}: {rest}"],
  ["{where} not reachable: {why}.", "{where} nicht erreichbar: {why}."], ["connection lost: {why}.", "Verbindung verloren: {why}."], ["device closed the connection.", "Das Gerät hat die Verbindung geschlossen."],
  ["device closed the connection in the middle of an answer.", "Das Gerät hat die Verbindung mitten in einer Antwort geschlossen."], ["not connected.", "Nicht verbunden."], ["is not connected: it did not hear the stop.", "Nicht verbunden: es hat den Halt nicht gehört."],
  ["no complete answer within {what} = {n} s.", "Keine vollständige Antwort binnen {what} = {n} s."], ["{where} did not accept within connect = {n} s.", "{where} nahm binnen connect = {n} s keine Verbindung an."],
  ["not there within move_s = {n} s: program paused, or speed slider low?", "Binnen move_s = {n} s nicht angekommen: Programm angehalten oder Geschwindigkeitsregler niedrig?"], ["program did not begin within start_s = {n} s.", "Das Programm begann nicht binnen start_s = {n} s."],
  ["program ended before its target or had another one, joint {joint} is {n} deg from where it was sent.", "Das Programm endete vor seinem Ziel oder hatte ein anderes, Achse {joint} ist {n} deg von dort, wohin sie geschickt wurde."],
  ["protective stop.", "Schutzhalt."], ["emergency stop pressed.", "Not-Halt gedrückt."], ["emergency stop of the system.", "Not-Halt der Anlage."], ["safeguard stop.", "Halt durch die Schutzeinrichtung."], ["enabling device released.", "Zustimmtaster losgelassen."],
  ["robot mode is '{mode}', needed 'running'.", "Der Roboter ist im Zustand '{mode}', nötig ist 'running'."], ["a program runs or is paused on the controller, or the arm moves.", "Ein Programm läuft oder ist angehalten, oder der Arm bewegt sich."], ["another program controls this robot.", "Ein anderes Programm steuert diesen Roboter."],
  ["Power the arm on and release its brakes on the pendant, then confirm.", "Am Bediengerät den Arm einschalten und seine Bremsen lösen, dann bestätigen."], ["Switch the controller to remote control on the pendant (e-Series), then confirm.", "Die Steuerung am Bediengerät auf Fernsteuerung stellen (e-Series), dann bestätigen."], ["Stop the program on the pendant and let go of the arm, then confirm.", "Das Programm am Bediengerät anhalten und den Arm loslassen, dann bestätigen."],
  ["another program changed {what} of the tracker.", "Ein anderes Programm hat am Tracker geändert: {what}."], ["Close the other program, see that the tracker knows the SMR that is seated, then confirm: it is set up anew.", "Das andere Programm schließen, prüfen, ob der Tracker den eingelegten SMR kennt, dann bestätigen: er wird neu eingerichtet."], ["target lost during the reading.", "Das Ziel ging während der Messung verloren."],
  ["its values scatter by {n} mm, less than the sensor can show.", "Seine Werte streuen um {n} mm, weniger, als der Sensor zeigen kann."], ["Have the bridge give d and sd in mm, not in m, and compare d with the maker's own program.", "Die Brücke d und sd in mm geben lassen, nicht in m, und d mit dem Programm des Herstellers vergleichen."],
  ["tracker says {n} ({what}).", "Der Tracker sagt {n} ({what})."], ["tracker says {n}.", "Der Tracker sagt {n}."], ["tracker is {what}.", "Der Tracker ist {what}."], ["no weather station.", "Keine Wetterstation."],
  ["controller in manual mode.", "Die Steuerung ist im Handbetrieb."], ["motors off.", "Die Motoren sind aus."],
  // devices: what to do
  ["Check that the bridge sends the turn of the body in the frame of the reference, scalar first, and that the body sits fast on the tool.", "Prüfen, ob die Brücke die Drehung des Körpers im System der Referenz und das Skalar zuerst sendet und ob der Körper fest am Werkzeug sitzt."],
  ["Confirm to measure it again; if it is the first pose that was wrong, begin anew.", "Bestätigen, um sie noch einmal zu messen; war die erste Pose falsch, von vorn beginnen."],
  ["Note what happened and call the person responsible for the cell.", "Aufschreiben, was geschah, und den Verantwortlichen der Zelle rufen."],
  ["Check cable, power and network address of the device; the program then connects again.", "Kabel, Strom und Netzadresse des Geräts prüfen; das Programm verbindet sich dann wieder."],
  ["Check that the device is on, its program runs and the address is its own, then connect again.", "Prüfen, ob das Gerät an ist, sein Programm läuft und die Adresse die seine ist; dann neu verbinden."],
  ["Check that the right device and program version answer at this address, then connect again.", "Prüfen, ob unter dieser Adresse das richtige Gerät mit der richtigen Programmversion antwortet; dann neu verbinden."],
  ["Look at the target and the line of sight, then repeat the measurement or skip the pose.", "Ziel und Sichtlinie ansehen, dann die Messung wiederholen oder die Pose auslassen."],
  ["Clear the line of sight, bring the beam back to the SMR and repeat the measurement.", "Die Sichtlinie frei machen, den Strahl wieder auf den SMR bringen und die Messung wiederholen."],
  ["Check that the SMR is seated and faces the instrument, then repeat the measurement.", "Prüfen, ob der SMR sitzt und zum Messgerät zeigt, dann die Messung wiederholen."],
  ["The point lies outside the instrument's range: skip the pose or move the instrument.", "Der Punkt liegt außerhalb der Reichweite des Messgeräts: die Pose auslassen oder das Messgerät versetzen."],
  ["Look whether the bridge still hears the instrument and a bar moves freely, then repeat the measurement.", "Nachsehen, ob die Brücke das Messgerät noch hört und ob ein Ballbar sich frei bewegt, dann die Messung wiederholen."],
  ["Wait until robot and air are calm, then repeat the measurement.", "Warten, bis Roboter und Luft ruhig sind, dann die Messung wiederholen."],
  ["Read the message, put the device in order and confirm to go on.", "Die Meldung lesen, das Gerät in Ordnung bringen und zum Weitermachen bestätigen."],
  ["Check that the cell is clear, then arm the device again.", "Prüfen, ob die Zelle frei ist, dann das Gerät wieder scharf schalten."],
  ["Close the other program that uses the device, then try again.", "Das andere Programm schließen, das das Gerät benutzt, dann noch einmal versuchen."],
  ["Remove this pose from the campaign, or correct the limits in the cell file.", "Diese Pose aus der Kampagne nehmen oder die Grenzen in der Zellendatei berichtigen."],
  ["Switch the controller to automatic mode and the motors on, then confirm.", "Die Steuerung auf Automatik und die Motoren einschalten, dann bestätigen."],
  ["Let the instrument finish its start-up and check its weather station, then confirm.", "Das Messgerät fertig starten lassen und seine Wetterstation prüfen, dann bestätigen."],
  ["Clear the alarm on the pendant, start the robot's programs again, then confirm.", "Die Störung am Bediengerät quittieren, die Programme des Roboters wieder starten, dann bestätigen."],
  ["The robot stopped on its way: check the cell, then arm it again; the pose is approached anew.", "Der Roboter hielt unterwegs an: die Zelle prüfen, dann wieder scharf schalten; die Pose wird neu angefahren."],
  ["Compare the position on the pendant with the one asked for before going on.", "Vor dem Weitermachen die Stellung am Bediengerät mit der geforderten vergleichen."],
  ["Find out why the safety function acted, reset it at the controller, then resume the campaign.", "Herausfinden, warum die Sicherheitsfunktion ansprach, sie an der Steuerung zurücksetzen, dann die Kampagne fortsetzen."],
  ["Start the program in a terminal or use the operator page, so that somebody can answer.", "Das Programm in einem Terminal starten oder die Bedienseite benutzen, damit jemand antworten kann."],
  ["Correct the cell or campaign file and start again.", "Die Zellen- oder Kampagnendatei berichtigen und neu beginnen."], ["The reading is left out; it can be measured again later.", "Die Messung ist ausgelassen; sie kann später noch einmal gemacht werden."],
  ["End the other program that runs this campaign, or look at it with 'campaign status'.", "Das andere Programm beenden, das diese Kampagne fährt, oder sie mit 'campaign status' ansehen."],
  ["Wait until the other campaign has ended, or pause it; one robot obeys one campaign at a time.", "Warten, bis die andere Kampagne zu Ende ist, oder sie pausieren; ein Roboter gehorcht immer nur einer Kampagne."],
  ["Connect the device of the record, or start a new record.", "Das Gerät der Aufzeichnung anschließen oder eine neue Aufzeichnung beginnen."],
  ["Only where both belong together: accept it by its serial number and with a reason (--accept-other SERIAL --reason TEXT).", "Nur wo beide zusammengehören: es mit seiner Seriennummer und einem Grund annehmen (--accept-other SERIENNUMMER --reason TEXT)."],
  ["Remove the pose, or correct limits, table, keep-out boxes or fixtures in the cell file, or the capsules of the robot file; nothing has moved.", "Die Pose entfernen, oder Grenzen, Tisch, Sperrräume oder Vorrichtungen in der Zellendatei oder die Kapseln der Roboterdatei berichtigen; nichts ist gefahren."],
  ["Jog the robot to a place high above the table, then confirm; or give the cell file a home_deg from which every pose can be reached.", "Den Roboter von Hand hoch über den Tisch fahren, dann bestätigen; oder der Zellendatei ein home_deg geben, von dem aus jede Pose zu erreichen ist."],
  ["Find out what moved it: a hand, the pendant, a brake.", "Herausfinden, was ihn bewegt hat: eine Hand, das Bediengerät, eine Bremse."], ["Nothing may move it between arrival and reading; confirm, and it approaches the pose anew.", "Nichts darf ihn zwischen Ankunft und Messung bewegen; bestätigen, dann fährt er die Pose neu an."],
  ["Check whether the bar sits on the balls named, with the right extension bar, and whether a cup has moved; confirm to measure again, skip to leave the leg out.", "Prüfen, ob der Ballbar auf den genannten Kugeln sitzt, mit der richtigen Verlängerung, und ob sich eine Pfanne bewegt hat; bestätigen misst noch einmal, Auslassen lässt die Strecke aus."],
  ["Jog the ball named into the cup named, then confirm: the touch is asked for again.", "Die genannte Kugel von Hand in die genannte Pfanne fahren, dann bestätigen: die Berührung wird noch einmal gefragt."],
  ["Where the cups do not stand where the cell file has them, correct its world.nests and begin a new record.", "Wo die Pfannen nicht stehen, wo die Zellendatei sie hat, deren world.nests berichtigen und eine neue Aufzeichnung beginnen."],
  ["Confirm to do it again; skip to go on with what was measured.", "Bestätigen wiederholt es; Auslassen geht mit dem Gemessenen weiter."], ["Check that every nest holds its SMR and that the cell file has their true positions.", "Prüfen, ob in jedem Nest sein SMR sitzt und ob die Zellendatei die wahren Orte hat."],
  ["Seat the SMR in the target named, then confirm.", "Den SMR in das genannte Ziel setzen, dann bestätigen."], ["Cover the SMRs that the beam may find instead.", "Die SMR abdecken, die der Strahl stattdessen finden kann."],
  ["If the robot is elsewhere than the cell file says, correct its world.nests or raise instrument.expected_within_mm.", "Steht der Roboter woanders, als die Zellendatei sagt, deren world.nests berichtigen oder instrument.expected_within_mm erhöhen."],
  ["Check that robot.model, joint_coupling and the targets in the cell file are those of this arm: the program keeps clear only by them.", "Prüfen, ob robot.model, joint_coupling und die Ziele in der Zellendatei die dieses Arms sind: nur nach ihnen weicht das Programm aus."], ["Confirm to go on where it is the line of sight.", "Bestätigen, um weiterzumachen, wo es an der Sichtlinie liegt."],
  ["Look at the cell, then resume the campaign; the robot will approach the pose anew.", "Die Zelle ansehen, dann die Kampagne fortsetzen; der Roboter fährt die Pose neu an."], ["Look at the state of the campaign: a finished one cannot be run again.", "Den Zustand der Kampagne ansehen: eine beendete kann nicht noch einmal gefahren werden."],
  ["Make room on the disk or correct its permissions, then resume the campaign.", "Platz auf der Platte schaffen oder ihre Rechte berichtigen, dann die Kampagne fortsetzen."], ["Find out which other program runs this campaign and end one of the two, then resume.", "Herausfinden, welches andere Programm diese Kampagne fährt, eines von beiden beenden, dann fortsetzen."],
  ["The computer slept, or its clock was set: look at its date and time and at the cell, then resume.", "Der Rechner schlief, oder seine Uhr wurde gestellt: Datum, Uhrzeit und Zelle ansehen, dann fortsetzen."],
  ["Give the folder of a record made by this program, or a new folder for a new campaign.", "Den Ordner einer Aufzeichnung dieses Programms angeben oder einen neuen Ordner für eine neue Kampagne."],
  // what a watch says, and what to do
  ["Nothing.", "Nichts."], ["Nothing has changed that {n} values could show.", "Nichts hat sich verändert, was {n} Werte zeigen könnten."],
  ["The robot has changed, and no single known cause explains it.", "Der Roboter hat sich verändert, und keine einzelne bekannte Ursache erklärt es."],
  ["Measure again; where it stays, recalibrate.", "Noch einmal messen; bleibt es, neu kalibrieren."], ["Make sure that this is the robot of the model.", "Sicherstellen, dass dies der Roboter des Modells ist."],
  ["Measure again with more poses, which can tell these apart.", "Mit mehr Posen noch einmal messen, die sie unterscheiden können."], ["No poses tell these apart; look.", "Keine Posen unterscheiden sie; nachsehen."], ["Or: {rest}.", "Oder: {rest}"],
  ["Joint {joint} lost its zero by {size}.", "Achse {joint} hat ihren Nullpunkt um {size} verloren."], ["Re-zero joint {joint} by {size}.", "Achse {joint} um {size} neu nullen."],
  ["Re-zero joint {joint} by {size}: where the controller shows 0 it stands at {at}.", "Achse {joint} um {size} neu nullen: wo die Steuerung 0 zeigt, steht sie bei {at}."],
  ["Joint {joint} has another play than at the calibration: {size}.", "Achse {joint} hat ein anderes Spiel als bei der Kalibrierung: {size}."],
  ["Have the gear of joint {joint} checked; until then correct targets with the updated model.", "Das Getriebe der Achse {joint} prüfen lassen; bis dahin Ziele mit dem nachgeführten Modell korrigieren."],
  ["Axis {joint} has another play than at the calibration: {size}.", "Achse {joint} hat ein anderes Spiel als bei der Kalibrierung: {size}."],
  ["Have the drive of axis {joint} checked; until then correct targets with the updated model.", "Den Antrieb der Achse {joint} prüfen lassen; bis dahin Ziele mit dem nachgeführten Modell korrigieren."],
  ["The base of the robot, or the frame of the instrument, moved: the arm's targets by {size}.", "Die Basis des Roboters oder das System des Messgeräts hat sich bewegt: die Ziele am Arm um {size}."],
  ["Measure the nests again; where it stays, re-teach the work frames or correct targets with the updated model.", "Die Nester noch einmal messen; bleibt es, die Werkstücksysteme neu teachen oder Ziele mit dem nachgeführten Modell korrigieren."],
  ["The tool moved on the flange: its targets by {size}.", "Das Werkzeug hat sich am Flansch bewegt: seine Ziele um {size}."], ["Re-teach the tool, or correct targets with the updated model.", "Das Werkzeug neu teachen oder Ziele mit dem nachgeführten Modell korrigieren."],
  ["The load on the flange is heavier than declared by {size}.", "Die Last am Flansch ist um {size} schwerer als angegeben."], ["Weigh the tool with all that hangs on it, and correct the load data.", "Das Werkzeug mit allem, was daran hängt, wiegen und die Lastdaten berichtigen."],
  ["The centre of the load on the flange lies elsewhere by {size}.", "Der Schwerpunkt der Last am Flansch liegt um {size} woanders."], ["Look for what was moved, added or taken off at the tool, and correct the load data.", "Suchen, was am Werkzeug versetzt, angebaut oder abgenommen wurde, und die Lastdaten berichtigen."],
  ["The instrument's scale differs from the calibration's by {size}.", "Der Maßstab des Messgeräts weicht um {size} von dem der Kalibrierung ab."], ["Check the weather station and the certificate of the instrument, and measure again.", "Wetterstation und Kalibrierschein des Messgeräts prüfen und noch einmal messen."],
  ["The instrument slid while it measured, by {size}.", "Das Messgerät hat sich während des Messens um {size} verschoben."], ["The instrument turned while it measured, by {size}.", "Das Messgerät hat sich während des Messens um {size} gedreht."],
  ["Let the instrument warm up on a firm stand, and measure again.", "Das Messgerät auf festem Stand warmlaufen lassen und noch einmal messen."],
  ["The arm has grown by {size} since the calibration: it is warmer, or colder where it shrank.", "Der Arm ist seit der Kalibrierung um {size} gewachsen: er ist wärmer, oder kälter, wo er schrumpfte."],
  ["Let the robot warm up as it had for the calibration, and measure again.", "Den Roboter wie zur Kalibrierung warmlaufen lassen und noch einmal messen."],
  ["Bring joint {joint} to its calibration mark and read the counter; look for a belt that jumped, a clamp that slipped, a collision between the two readings.", "Achse {joint} auf ihre Kalibriermarke stellen und den Zähler ablesen; nach einem übergesprungenen Riemen, einer gerutschten Klemme oder einer Kollision zwischen den beiden Messungen suchen."],
  ["Look for what moved the robot's foot or the instrument's stand: anchor bolts, tripod feet, traffic; measure the nests again.", "Suchen, was den Fuß des Roboters oder den Stand des Messgeräts bewegt hat: Ankerbolzen, Stativfüße, Verkehr; die Nester noch einmal messen."],
  ["Look for what struck or loosened the tool: clamp, bolts, marks on the targets; the readings before and after belong to two tools.", "Suchen, was das Werkzeug getroffen oder gelockert hat: Klemme, Schrauben, Spuren an den Zielen; die Messungen davor und danach gehören zu zwei Werkzeugen."],
  ["Check the preload of the gear of joint {joint}: with the brakes on, push the arm by hand both ways and read a dial gauge; compare with the limit in the maker's manual.", "Die Vorspannung des Getriebes der Achse {joint} prüfen: bei geschlossenen Bremsen den Arm von Hand hin und her drücken und eine Messuhr ablesen; mit der Grenze im Handbuch des Herstellers vergleichen."],
  ["Check the play between pinion and rack, or the preload of nut or belt, of axis {joint}: push the carriage both ways with the brakes on and read a dial gauge.", "Das Spiel zwischen Ritzel und Zahnstange oder die Vorspannung von Mutter oder Riemen der Achse {joint} prüfen: bei geschlossenen Bremsen den Schlitten hin und her drücken und eine Messuhr ablesen."],
  ["Weigh the tool with everything that hangs on it, and correct the load data in the controller.", "Das Werkzeug mit allem, was daran hängt, wiegen und die Lastdaten in der Steuerung berichtigen."],
  ["Work out the centre of mass of tool, hoses and cables anew, and correct the load data in the controller.", "Den Schwerpunkt von Werkzeug, Schläuchen und Kabeln neu ermitteln und die Lastdaten in der Steuerung berichtigen."],
  ["Check the stand of the instrument: feet, clamp, floor; let it warm up for two hours and measure the nests between the poses.", "Den Stand des Messgeräts prüfen: Füße, Klemme, Boden; zwei Stunden warmlaufen lassen und die Nester zwischen den Posen messen."],
  ["Check that the instrument's stand does not creep or turn, keep the sun off it, and measure the nests between the poses.", "Prüfen, ob der Stand des Messgeräts kriecht oder sich dreht, die Sonne fernhalten und die Nester zwischen den Posen messen."],
  ["Check the weather station of the instrument (air temperature, pressure) and the date of its certificate; measure a reference length.", "Die Wetterstation des Messgeräts (Lufttemperatur, Druck) und das Datum seines Kalibrierscheins prüfen; eine Referenzlänge messen."],
  ["Ask how long the robot had run before it was measured, then and now, and what warms or cools it.", "Erfragen, wie lange der Roboter vor dem Messen gelaufen war, damals und jetzt, und was ihn wärmt oder kühlt."],
  ["What has changed is how warm the arm is, or nothing: the rest is chance.", "Verändert hat sich, wie warm der Arm ist, oder nichts: der Rest ist Zufall."], ["Not updated: something else has changed.", "Nicht nachgeführt: etwas anderes hat sich verändert."],
  ["Measure the check poses of a watch, and judge them.", "Die Prüfposen einer Überwachung messen und beurteilen."], ["Correct targets with the updated model.", "Ziele mit dem nachgeführten Modell korrigieren."], ["Write it with --update.", "Mit --update schreiben."],
  ["Every cause with a wanted size is detected at that size in {n} of watches or more.", "Jede Ursache mit einer gewünschten Größe wird in dieser Größe in mindestens {n} der Überwachungen erkannt."],
  ["The tool was moved on the flange between two readings.", "Das Werkzeug wurde zwischen zwei Messungen am Flansch bewegt."], ["The base, or the instrument, was moved between two readings.", "Die Basis oder das Messgerät wurde zwischen zwei Messungen bewegt."],
  ["The zero of joint {joint} jumped between two readings.", "Der Nullpunkt der Achse {joint} sprang zwischen zwei Messungen."], ["Joint {joint} has play: it stops short on the side from which it arrives.", "Achse {joint} hat Spiel: sie bleibt auf der Seite zurück, von der sie kommt."],
  ["The load on the last link is heavier or lighter than declared.", "Die Last am letzten Glied ist schwerer oder leichter als angegeben."], ["The centre of the load on the last link lies elsewhere than declared.", "Der Schwerpunkt der Last am letzten Glied liegt woanders als angegeben."],
  ["The instrument measures every length too long or too short.", "Das Messgerät misst jede Länge zu lang oder zu kurz."], ["The instrument slides away with time.", "Das Messgerät verschiebt sich mit der Zeit."], ["The instrument turns about its station with time.", "Das Messgerät dreht sich mit der Zeit um seinen Standpunkt."],
  ["The arm is warmer or colder than at its calibration.", "Der Arm ist wärmer oder kälter als bei seiner Kalibrierung."],
  ["Measured with the instrument {now}, the baseline with {was}: their scales may differ.", "Gemessen mit dem Messgerät {now}, das Bezugsmodell mit {was}: ihre Maßstäbe können sich unterscheiden."],
  ["SIMULATED: the model was identified from a simulated robot and instrument; it says nothing of a real one.", "SIMULIERT: das Modell wurde an einem simulierten Roboter und Messgerät bestimmt; über einen echten sagt es nichts."],
  // when a robot is to be checked
  ["It was never checked.", "Er wurde nie geprüft."], ["No permitted error is set.", "Es ist kein erlaubter Fehler gesetzt."],
  ["Now: the last watch found it changed.", "Jetzt: die letzte Überwachung fand ihn verändert."], ["Now: the last watch found it ambiguous.", "Jetzt: die letzte Überwachung fand ihn verändert, mit mehreren möglichen Ursachen."],
  ["Now: the last watch found it unexplained.", "Jetzt: die letzte Überwachung fand ihn verändert, ohne bekannte Ursache."],
  ["The last check found {off} (U {u}) of {limit} permitted: too much, so the interval is {now} days instead of {was}.", "Die letzte Prüfung fand {off} (U {u}) von {limit} erlaubten: zu viel, also ist der Abstand {now} Tage statt {was}."],
  ["The last check found {off} (U {u}) of {limit} permitted, within {share}: the interval is {now} days after {was}.", "Die letzte Prüfung fand {off} (U {u}) von {limit} erlaubten, innerhalb von {share}: der Abstand ist {now} Tage nach {was}."],
  ["The last check found {off} (U {u}) of {limit} permitted: the interval stays {now} days.", "Die letzte Prüfung fand {off} (U {u}) von {limit} erlaubten: der Abstand bleibt {now} Tage."],
  ["One check shows no drift: the interval is the first, {n} days.", "Eine Prüfung zeigt keine Drift: der Abstand ist der erste, {n} Tage."],
  ["The value drifts by {b} (U {u}) per day and may be beyond the {limit} permitted already: {n} days.", "Der Wert driftet um {b} (U {u}) am Tag und liegt vielleicht schon jenseits der {limit} erlaubten: {n} Tage."],
  ["The value drifts by {b} (U {u}) per day and stays within the {limit} permitted: the longest, {n} days.", "Der Wert driftet um {b} (U {u}) am Tag und bleibt innerhalb der {limit} erlaubten: der längste, {n} Tage."],
  ["The value drifts by {b} (U {u}) per day and may reach the {limit} permitted {n} days after the last check.", "Der Wert driftet um {b} (U {u}) am Tag und erreicht die {limit} erlaubten vielleicht {n} Tage nach der letzten Prüfung."],
  ["It is retired.", "Er ist außer Dienst."], ["One value makes no chart.", "Ein Wert ergibt keine Karte."], ["The value of {day} is {value}, {far} from the centre {centre}; the limit is {limit}.", "Der Wert vom {day} ist {value}, {far} von der Mitte {centre}; die Grenze ist {limit}."],
  ["The value of {day} has a weighted mean with those before it of {value}, {far} from the centre {centre}; the limit is {limit}.", "Der Wert vom {day} hat mit denen davor ein gewichtetes Mittel von {value}, {far} von der Mitte {centre}; die Grenze ist {limit}."],
  ["{rest}; overdue by {late} days.", "{rest} Überfällig seit {late} Tagen."],
];

// A template as a pattern that begins where it is tried and ends where a sentence may; a fragment, which has no stop,
// counts only as the whole text. What is taken over is of one sentence, so that no pattern reaches beyond its own.
const ESCAPED = /[.*+?^$()|[\]\\]/g;
const end = (english) => (english.endsWith(".") ? "(?:\\.(?= |$)|$)" : /[!?;]$/.test(english) ? "(?= |$)" : "$");
const hole = (_, name) => (name === "rest" ? "(?<rest>(?:(?![.!?] ).)+?)" : name === "device" ? "(?<device>[\\w-]+)" : `(?<${name}>(?:(?![.!?] |;).)+?)`);
const PATTERNS = [...SENTENCES, ...DEVICE_SENTENCES, ...EFFECT_SENTENCES].map(([english, german]) => [new RegExp(english.replace(/\.$/, "").replace(ESCAPED, "\\$&").replace(/\{(\w+)\}/g, hole) + end(english), "iy"), english, german]);
const FIXED = (english) => english.replace(/\{\w+\}/g, "").length;

// The parts of a text, [{words, lang}]: the longest known sentence at every place, and what is unknown up to its end.
export function parts(text) {
  const found = [];
  for (let at = 0; at < text.length;) {
    const known = PATTERNS.map(([pattern, english, german]) => { pattern.lastIndex = at; return { match: pattern.exec(text), fixed: FIXED(english), german }; })
      .filter((each) => each.match).sort((a, b) => b.fixed - a.fixed)[0];
    if (known) {
      const { rest, ...values } = known.match.groups || {};
      for (const name of Object.keys(values)) if (name.startsWith("list")) values[name] = values[name].split(", ").map(germanOf).join(", ");
      const words = known.german.replace(/\{(\w+)\}/g, (_, name) => (name === "rest" ? "" : values[name]));
      found.push({ words: words.trim(), lang: "de" });
      at += known.match[0].length + 1;
      if (rest !== undefined) found.splice(found.length - 1, 1, ...around(known.german, rest, values));
    } else {
      const end = text.slice(at).search(/[.!?] /), stop = end < 0 ? text.length : at + end + 1;
      found.push({ words: text.slice(at, stop), lang: "en" });
      at = stop + 1;
    }
  }
  return found;
}

// A sentence within another: before it, itself, behind it.
function around(german, rest, values) {
  const put = (words) => words.replace(/\{(\w+)\}/g, (_, name) => values[name]).trim(), [before, behind] = german.split("{rest}").map(put);
  const ended = /[.!?]$/.test(rest) ? rest : `${rest}.`;
  return [before && { words: before, lang: "de" }, ...parts(ended), behind && { words: behind, lang: "de" }].filter(Boolean);
}

// What the service says, as spans that say their language: for a reader of the screen, too.
export function said(text) {
  if (!text) return [];
  if (language() === "en") return [h("span", { lang: "en" }, text)];
  return parts(text).flatMap(({ words, lang }, i) => [i ? " " : null, h("span", { lang }, words)]).filter(Boolean);
}

// Why a run does not go on: what is to be done at once stands out, and what a device met names the device.
export function reasonOf(run, cell) {
  const [urgent] = /^Press the emergency stop[^.]*\./.exec(run.reason) || [""], rest = run.reason.slice(urgent.length).trim();
  const { device = "", message = "" } = run.error || {}, { robot_driver: robot, instrument_driver: instrument } = cell || {};
  const which = device && device === robot ? t("robot") : device && device === instrument ? t("instrument") : "";
  const told = which && rest.startsWith(`${device}: `) ? rest.slice(device.length + 2) : rest;
  return [urgent && h("strong", { className: "urgent" }, said(urgent)), which && message && told.startsWith(message) ? `${which} (${device}): ` : "", ...said(told)].filter(Boolean);
}

const germanOf = (text) => parts(text).map((each) => each.words).join(" ");
export const saidWords = (text) => (language() === "en" || !text ? text || "" : germanOf(text));
