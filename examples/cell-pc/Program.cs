using System;
using System.IO;
using System.Net;
using System.Net.Http;
using System.Net.Http.Headers;
using System.Runtime.Serialization.Json;
using System.Text;
using System.Threading;
using System.Threading.Tasks;
using System.Xml;
using System.Xml.Linq;

class Refused : Exception
{
    public readonly HttpStatusCode Status;
    public Refused(HttpStatusCode status, string text) : base(text) { Status = status; }
}

class Cell
{
    readonly HttpClient http = new HttpClient { Timeout = TimeSpan.FromSeconds(60) };
    readonly string url;

    public Cell(string address, string token)
    {
        url = address + "/api/v1";
        http.DefaultRequestHeaders.Authorization = new AuthenticationHeaderValue("Bearer", token);
    }

    // null for null; what an object holds are its elements
    public static XElement At(XElement json, string name)
    {
        var found = json.Element(name);
        return found == null || (string)found.Attribute("type") == "null" ? null : found;
    }

    static XElement Json(string text)
    {
        var quotas = XmlDictionaryReaderQuotas.Max;
        using (var reader = JsonReaderWriterFactory.CreateJsonReader(Encoding.UTF8.GetBytes(text), quotas))
            return XElement.Load(reader);
    }

    public async Task<XElement> Ask(HttpMethod method, string path, string body = null, string lease = null, string key = null)
    {
        using (var request = new HttpRequestMessage(method, url + path))
        {
            if (body != null) request.Content = new StringContent(body, Encoding.UTF8, "application/json");
            if (lease != null) request.Headers.Add("Lease-Id", lease);
            if (key != null) request.Headers.Add("Idempotency-Key", key);
            using (var answer = await http.SendAsync(request))
            {
                var text = await answer.Content.ReadAsStringAsync();
                var json = text == "" ? null : Json(text);
                if (answer.IsSuccessStatusCode) return json;
                throw new Refused(answer.StatusCode, (string)json.Element("operator_text") + " " + (string)json.Element("what_to_do"));
            }
        }
    }

    // the same key: sent again where no answer came, done once
    public async Task<XElement> Once(string path, string body, string lease = null)
    {
        var key = Guid.NewGuid().ToString();
        for (var tries = 1; ; tries++)
        {
            try { return await Ask(HttpMethod.Post, path, body, lease, key); }
            catch (HttpRequestException) { if (tries == 5) throw; }
            catch (TaskCanceledException) { if (tries == 5) throw; }
            await Task.Delay(1000);
        }
    }

    // by a long poll; null where none came: the network may come back
    public async Task<XElement> Next(string path, XElement last)
    {
        try { return await Ask(HttpMethod.Get, path + "?wait=20&after=" + (string)last.Element("version")); }
        catch (HttpRequestException) { }
        catch (TaskCanceledException) { }
        await Task.Delay(1000);
        return last;
    }

    public Task<string> Text(string path) { return http.GetStringAsync(url + path); }

    // needs no lease; whether it was heard in time, and by the robot too
    public bool Stop(string id)
    {
        try
        {
            var told = Ask(HttpMethod.Post, "/runs/" + id + "/stop");
            return told.Wait(5000) && !told.Result.Element("problems").HasElements;
        }
        catch (AggregateException) { return false; }
    }
}

class Program
{
    const string Me = "{\"holder\": \"cell PC\", \"seconds\": 30}";

    static int Main(string[] arguments)
    {
        // .NET Framework opens two connections, and a third order would wait for the long poll: a stop must not
        ServicePointManager.DefaultConnectionLimit = 16;
        ServicePointManager.Expect100Continue = false;
        try { return Campaign(File.ReadAllText(arguments[0])).GetAwaiter().GetResult(); }
        catch (Refused refused) { Console.Error.WriteLine(refused.Message); return 1; }
    }

    static async Task Heartbeat(Cell cell, string lease, CancellationToken ended)
    {
        while (true)
        {
            try { await Task.Delay(10000, ended); await cell.Ask(HttpMethod.Post, "/cell/lease", Me, lease); }
            catch (OperationCanceledException) { if (ended.IsCancellationRequested) return; }
            catch (HttpRequestException) { }  // the network may come back in time
            catch (Refused refused) { Console.Error.WriteLine("The lease is lost: " + refused.Message); return; }
        }
    }

    static async Task<int> Campaign(string campaign)
    {
        var cell = new Cell(Environment.GetEnvironmentVariable("TRUEPOSE_URL"), Environment.GetEnvironmentVariable("TRUEPOSE_TOKEN"));
        var lease = (string)(await cell.Once("/cell/lease", Me)).Element("lease_id");
        var ended = new CancellationTokenSource();
        var heartbeat = Task.Run(() => Heartbeat(cell, lease, ended.Token));

        var run = await cell.Once("/runs", "{\"campaign\": " + campaign + ", \"dry_run\": false, \"name\": \"night 1\"}", lease);
        var id = (string)run.Element("id");
        Console.CancelKeyPress += (sender, e) => { if (!cell.Stop(id)) Console.Error.WriteLine("NOT stopped: press the emergency stop."); };
        while ("succeeded failed paused stopped".IndexOf((string)run.Element("state")) < 0)
        {
            run = await cell.Next("/runs/" + id, run);
            Console.WriteLine("{0}: {1} of {2}", (string)run.Element("state"), (string)run.Element("done"), (string)run.Element("total"));
            var prompt = Cell.At(run, "prompt");
            if (prompt == null) continue;
            Console.WriteLine((string)prompt.Element("text"));  // ask the person first
            try { await cell.Once("/runs/" + id + "/prompts/" + (string)prompt.Element("id") + "/confirm", "{\"reason\": \"\"}", lease); }
            catch (Refused refused) { if (refused.Status != HttpStatusCode.Conflict) throw; }  // somebody was quicker
        }
        ended.Cancel();
        await heartbeat;
        await cell.Ask(HttpMethod.Delete, "/cell/lease", null, lease);
        if ((string)run.Element("state") != "succeeded") { Console.Error.WriteLine((string)run.Element("reason")); return 1; }

        var data = await cell.Once("/runs/" + id + "/dataset", "{}");
        var job = await cell.Once("/diagnoses", "{\"dataset_id\": \"" + (string)data.Element("id") + "\", \"accept_rms_mm\": 0.2}");
        var result = "/diagnoses/" + (string)job.Element("id");
        while ("succeeded failed".IndexOf((string)job.Element("state")) < 0) job = await cell.Next(result, job);
        if ((string)job.Element("state") == "failed") { Console.Error.WriteLine((string)job.Element("problem").Element("operator_text")); return 1; }
        var found = job.Element("result");
        Console.WriteLine("{0}, {1}", (string)found.Element("verdict"), (string)found.Element("acceptance").Element("verdict"));
        File.WriteAllText("report.html", await cell.Text("/reports/" + (string)job.Element("id")));
        return 0;
    }
}
