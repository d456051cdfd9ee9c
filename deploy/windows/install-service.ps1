# TruePose at the start of a Windows PC, as a task of the Task Scheduler under an account of its own.
# UNTESTED: TruePose is developed without a Windows PC. Read this script before you run it, and please report what happened.
#
#   powershell -ExecutionPolicy Bypass -File install-service.ps1 -Wheel C:\install\truepose-0.1.0-py3-none-any.whl `
#       -Wheels C:\install\wheels -Cell C:\install\cell.toml
#
# It makes a task, not a service of the Service Control Manager, which would need a wrapper program. Ending the task kills
# the program without a signal, as a power cut does: every reading that was acknowledged is in the record, and the
# campaign is paused. Pause it first all the same.
# Records are readable by their owner alone: on Windows that is the access list of the folder, which is set here.
param(
    [Parameter(Mandatory)] [string] $Wheel,
    [Parameter(Mandatory)] [string] $Wheels,     # folder with the wheels of its dependencies: pip wheel, on another PC
    [Parameter(Mandatory)] [string] $Cell,
    [string] $Home_ = "C:\ProgramData\TruePose",
    [int] $Port = 8035,
    [string] $Account = "NT AUTHORITY\LOCAL SERVICE"
)
$ErrorActionPreference = "Stop"
$data = Join-Path $Home_ "data"
$python = Join-Path $Home_ "env\Scripts\python.exe"

New-Item -ItemType Directory -Force $Home_, $data | Out-Null
py -3 -m venv (Join-Path $Home_ "env")
if ($LASTEXITCODE -ne 0) { throw "No environment: is Python 3.11 or newer installed, with the launcher py?" }
& $python -m pip install --no-index --find-links $Wheels "${Wheel}[cell]"
if ($LASTEXITCODE -ne 0) { throw "pip could not install $Wheel from $Wheels." }
Copy-Item $Cell (Join-Path $Home_ "cell.toml") -Force

# The folder is for the account of the service and for administrators; nobody inherits anything.
icacls $data /inheritance:r /grant "${Account}:(OI)(CI)F" "BUILTIN\Administrators:(OI)(CI)F" | Out-Null
if ($LASTEXITCODE -ne 0) { throw "The access list of $data could not be set." }

$arguments = "-X utf8 -m truepose serve --port $Port --cell `"$Home_\cell.toml`" --record `"$data\record`" --token-file `"$data\tokens`""
$action = New-ScheduledTaskAction -Execute $python -Argument $arguments -WorkingDirectory $data
$trigger = New-ScheduledTaskTrigger -AtStartup
$principal = New-ScheduledTaskPrincipal -UserId $Account -LogonType ServiceAccount
$settings = New-ScheduledTaskSettingsSet -RestartCount 3 -RestartInterval (New-TimeSpan -Minutes 1) `
    -ExecutionTimeLimit ([TimeSpan]::Zero) -AllowStartIfOnBatteries -DontStopIfGoingOnBatteries -MultipleInstances IgnoreNew
Register-ScheduledTask -TaskName "TruePose" -Action $action -Trigger $trigger -Principal $principal -Settings $settings -Force | Out-Null
Start-ScheduledTask -TaskName "TruePose"

Write-Host "TruePose listens on http://127.0.0.1:$Port, this PC alone. Tokens: $data\tokens (as administrator)."
Write-Host "Remove it: Unregister-ScheduledTask TruePose; the records stay in $data."
