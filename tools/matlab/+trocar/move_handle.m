classdef move_handle < handle
    % A move under way: what move_jp and its like return.

    properties (SetAccess = protected)
        clipped = ''  % joints whose goals lay beyond their limits, from where to where; empty: none
        short = ''    % once it is over: joints that are not where they were sent, and by how much; empty: all are
    end

    properties (Access = private)
        bridge
        to
        number
        what
        done = false
        refusal = ''
        accepted = ''
    end

    methods

        function self = move_handle(bridge, to, reply, what)
            % Made by arms, from the first answer to the command.
            self.bridge = bridge;
            self.to = to;
            self.number = reply.id;
            self.what = what;
            self.accepted = reply.text;
            self.done = strcmp(reply.outcome, 'done');
            if strncmp(reply.text, 'clipped: ', 9)
                self.clipped = reply.text(10:end);
                warning('trocar:clipped', '%s was clipped: %s', what, self.clipped);
            end
        end

        function busy = is_busy(self)
            % Whether it still moves; trocar:refused when it ended before its goal.
            if ~self.done && isempty(self.refusal)
                replies = self.bridge.replies_to(self.number);
                for k = 1:numel(replies)
                    self.take(replies{k});
                end
            end
            if ~isempty(self.refusal)
                error('trocar:refused', '%s', self.refusal);
            end
            busy = ~self.done;
        end

        function result = wait(self, is_busy, timeout)
            % Until it is over; trocar:timeout after `timeout` s (30). With `is_busy` true: until it has begun.
            if nargin < 2, is_busy = false; end
            if nargin < 3, timeout = 30; end
            result = true;
            if is_busy
                return
            end
            trocar.internal.wait_until(@() ~self.is_busy(), self.bridge, self.to, timeout, ...
                                  [self.what ' is not done']);
        end

    end

    methods (Access = private)

        function take(self, reply)
            if strcmp(reply.op, 'error')
                self.refusal = [self.what ': ' reply.error];
            elseif strcmp(reply.outcome, 'refused')
                self.refusal = [self.what ' was refused: ' reply.text];
            elseif strcmp(reply.outcome, 'failed')
                self.refusal = [self.what ' failed: ' reply.text];
            end
            if isfield(reply, 'outcome') && strcmp(reply.outcome, 'done') && ~self.done
                self.done = true;
                self.short = regexprep(reply.text(numel(self.accepted) + 1:end), '^; ', '');
                if ~isempty(self.short)
                    warning('trocar:short', '%s is done, %s', self.what, self.short);
                end
            end
        end

    end

end
