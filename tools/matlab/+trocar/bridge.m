classdef bridge < handle
    % A connection to the socket bridge of a running system (docs/socket.md); for MATLAB and for Octave.
    %
    %   b = trocar.bridge('127.0.0.1:7380');
    %   b = trocar.bridge('robot.lab:7380', 'token');
    %
    % Arms make their own, or share one: trocar.psm('PSM1', b). Waits poll, so Ctrl-C ends them.
    %
    % Errors: trocar:refused (the robot did not do it, with its reason), trocar:timeout (no answer, or no value now),
    % trocar:lost (no connection), trocar:argument (no pose, another size; nothing was sent).

    properties (SetAccess = protected)
        at         % HOST:PORT
        system     % name of the system
        clock      % wall, paced or lockstep
        instances  % struct: the type of arms, the kind of others
        grants     % command, or view
        may_power  % whether power and homing may be asked for here
    end

    properties (Access = private)
        socket = []
        rest = ''
        count = 0
        heard
    end

    methods

        function self = bridge(at, token, timeout)
            % Connect, for `timeout` s (5) at most; trocar:lost: nobody is there, trocar:refused: it is not the token.
            if nargin < 2, token = ''; end
            if nargin < 3, timeout = 5; end
            self.at = at;
            self.heard = containers.Map('KeyType', 'double', 'ValueType', 'any');
            [host, port] = trocar.internal.address(at);
            begun = tic;
            while isempty(self.socket)
                try
                    self.socket = trocar.internal.open_socket(host, port);
                catch reason
                    if toc(begun) >= timeout
                        error('trocar:lost', '%s is not connected after %g s: %s', at, timeout, ...
                              trocar.internal.first_line(reason.message));
                    end
                    pause(0.2);
                end
            end
            hello = self.ask(struct('op', 'hello', 'token', token, 'name', 'matlab'), timeout);
            self.system = hello.system;
            self.clock = hello.clock;
            self.instances = hello.instances;
            self.grants = hello.grants;
            self.may_power = hello.may_power;
        end

        function delete(self)
            % Leave.
            self.socket = [];
        end

        function answer = ask(self, message, timeout)
            % A message of docs/socket.md, and its answer, a struct; trocar:refused: the bridge says why there is none.
            if nargin < 3, timeout = 5; end
            answer = self.first(self.say(message), timeout, {});
            if isempty(answer)
                error('trocar:timeout', '%s did not answer within %g s', self.at, timeout);
            end
            if strcmp(answer.op, 'error')
                error('trocar:refused', '%s', answer.error);
            end
        end

        function row = read(self, topic)
            % The newest record of a topic; trocar:timeout when it is older than 1 s or not valid now.
            row = self.ask(struct('op', 'read', 'topic', topic));
            if isempty(row.age_s) || row.age_s > 1
                error('trocar:timeout', '%s has not been shown for 1 s', topic);
            end
        end

        function row = valid(self, topic)
            % The same of a view, where its values may be used.
            row = self.read(topic);
            if ~row.valid
                error('trocar:timeout', '%s is not valid now (is the arm powered and homed?)', topic);
            end
        end

        function [jp, jv, jf, timestamp] = joint_state(self, topic)
            % What a view shows of joints: columns of rad and m, their velocities and efforts; empty where it has none.
            row = self.valid(topic);
            jp = row.position(:);
            jv = row.velocity(:);
            jf = row.effort(:);
            timestamp = row.stamp_ns * 1e-9;
        end

        function [matrix, timestamp] = pose(self, topic)
            % The pose that a view shows, 4x4.
            row = self.valid(topic);
            matrix = trocar.internal.matrix_of([row.position(:); row.orientation(:)]);
            timestamp = row.stamp_ns * 1e-9;
        end

        function [numbers, timestamp] = six(self, topic, first, second)
            % The twist or wrench that a view shows, 1x6.
            row = self.valid(topic);
            numbers = [row.(first)(:); row.(second)(:)].';
            timestamp = row.stamp_ns * 1e-9;
        end

        function text = command(self, to, name, values, text)
            % Command, and wait until it is accepted; trocar:refused has the reason. What was answered.
            if nargin < 4, values = []; end
            if nargin < 5, text = ''; end
            reply = self.accepted(to, name, values, text);
            text = reply.text;
        end

        function handle = move(self, to, name, values, text)
            % Command something that takes its time: a trocar.move_handle.
            if nargin < 5, text = ''; end
            reply = self.accepted(to, name, values, text);
            words = {to, text, name};
            handle = trocar.move_handle(self, to, reply, strjoin(words(~cellfun(@isempty, words)), ' '));
        end

        function settle(self, to, name, text, timeout)
            % Command, and wait for the end, `timeout` s at most; trocar:refused says why it was not done.
            number = self.call(to, name, [], text);
            limit = trocar.deadline(self, to, timeout);
            reply = [];
            while isempty(reply)
                reply = self.first(number, 0.2, {'refused', 'done', 'failed'});
                if isempty(reply) && limit.is_over()
                    error('trocar:timeout', '%s: %s %s is not done after %g s', to, name, text, timeout);
                end
            end
            if strcmp(reply.op, 'error')
                error('trocar:refused', '%s', reply.error);
            elseif ~strcmp(reply.outcome, 'done')
                error('trocar:refused', '%s: %s was %s: %s', to, strtrim([name ' ' text]), reply.outcome, reply.text);
            end
        end

        function found = replies_to(self, number)
            % What came of a command since the last call: a cell array of structs.
            while self.hear()
            end
            found = {};
            if isKey(self.heard, number)
                found = self.heard(number);
                remove(self.heard, number);
            end
        end

        function number = say(self, message)
            % Send a message; its number.
            self.count = self.count + 1;
            number = self.count;
            message.id = number;
            self.write(message);
        end

        function check(self)
            % trocar:lost when nobody is there any more; called while nothing comes.
            self.write(struct('op', 'ping'));
        end

    end

    methods (Access = private)

        function reply = accepted(self, to, name, values, text)
            reply = self.first(self.call(to, name, values, text), 2, {});
            if isempty(reply)
                error('trocar:timeout', '%s did not answer %s within 2 s', to, name);
            elseif strcmp(reply.op, 'error')
                error('trocar:refused', '%s', reply.error);
            elseif ~any(strcmp(reply.outcome, {'accepted', 'done'}))
                error('trocar:refused', '%s', reply.text);
            end
        end

        function number = call(self, to, name, values, text)
            values = double(values(:).');
            if ~all(isfinite(values))
                error('trocar:refused', 'values must be finite numbers');
            end
            number = self.say(struct('op', 'call', 'to', to, 'command', name, 'values', {num2cell(values)}, ...
                                     'text', text));
        end

        function message = first(self, number, timeout, outcomes)
            % The next answer about a message, of these outcomes if any are given; empty when there is none in time.
            begun = tic;
            looked = 0.25;
            message = [];
            while true
                while self.hear()
                end
                while isKey(self.heard, number)
                    waiting = self.heard(number);
                    message = waiting{1};
                    if numel(waiting) > 1
                        self.heard(number) = waiting(2:end);
                    else
                        remove(self.heard, number);
                    end
                    if strcmp(message.op, 'error') || isempty(outcomes) || any(strcmp(message.outcome, outcomes))
                        return
                    end
                    message = [];
                end
                if toc(begun) >= timeout
                    return
                end
                if toc(begun) > looked
                    looked = toc(begun) + 0.25;
                    self.check();
                end
                pause(0.001);
            end
        end

        function found = hear(self)
            % Take in what has come; false when nothing has.
            if isempty(self.socket)
                error('trocar:lost', 'the bridge at %s is gone', self.at);
            end
            data = trocar.internal.received(self.socket);
            found = ~isempty(data);
            if ~found
                return
            end
            self.rest = [self.rest, data];
            ends = find(self.rest == 10);
            begin = 1;
            for k = 1:numel(ends)
                self.keep(jsondecode(self.rest(begin:ends(k) - 1)));
                begin = ends(k) + 1;
            end
            self.rest = self.rest(begin:end);
        end

        function keep(self, message)
            % Keep an answer until it is asked for; of those nobody asks for the last 1000.
            if isfield(message, 'id')
                waiting = {};
                if isKey(self.heard, message.id)
                    waiting = self.heard(message.id);
                end
                self.heard(message.id) = [waiting, {message}];
                if self.heard.Count > 1000
                    oldest = keys(self.heard);
                    remove(self.heard, oldest{1});
                end
            elseif strcmp(message.op, 'error')
                self.socket = [];
                error('trocar:lost', '%s: %s', self.at, message.error);
            end
        end

        function write(self, message)
            if isempty(self.socket)
                error('trocar:lost', 'the bridge at %s is gone', self.at);
            end
            try
                trocar.internal.send(self.socket, unicode2native([jsonencode(message) char(10)], 'UTF-8'));
            catch reason
                self.socket = [];
                error('trocar:lost', 'the bridge at %s is gone: %s', self.at, reason.message);
            end
        end

    end

end
